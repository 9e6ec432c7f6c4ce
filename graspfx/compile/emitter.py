"""One process of `graspfx.compile.emitters`: texts for LLVM come in, machine code goes out."""

from __future__ import annotations

import json
import sys

from graspfx.compile.emission import best


def main() -> None:
    """Emit the machine code of each text, one on a line as JSON, until the parent closes the pipe."""
    for line in sys.stdin.buffer:
        text, lanes = json.loads(line)
        machine = best(text, lanes=lanes)
        sys.stdout.buffer.write(f"{len(machine)}\n".encode() + machine)
        sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
