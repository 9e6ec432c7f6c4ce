"""Directive that documents the public names of a module, from the table of docs/reference/python.md.

`.. public-names:: graspfx.stability` documents all names of a module, `.. public-names:: graspfx runs` a group of them.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from functools import cache
from types import ModuleType
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

from machinery import docstrings
from tests.support.face import MODULES, constant_text, home, members, names


class PublicNames(SphinxDirective):
    """The documentation of a module's public names, one after another."""

    required_arguments, optional_arguments = 1, 1

    def run(self) -> list[nodes.Node]:
        """Write the directives of autodoc, and parse them."""
        module = self.arguments[0]
        lines = [line for name in names(*self.arguments) for line in _wish(module, MODULES[module], name)]
        box = nodes.container()
        self.state.nested_parse(StringList(lines, self.get_source_info()[0]), self.content_offset, box)
        return box.children


def _wish(path: str, module: ModuleType, name: str) -> Iterator[str]:
    """Write the directive for one name."""
    value = getattr(module, name)
    if inspect.isclass(value):
        kind = "exception" if issubclass(value, BaseException) else "class"
        yield f".. auto{kind}:: {path}.{name}"
        if home(value, name) != path:
            yield "   :no-index:"
        if public := [member.removesuffix("()") for member, _ in members(value)]:
            yield f"   :members: {', '.join(public)}"
    elif inspect.isroutine(value):
        yield f".. autofunction:: {path}.{name}"
    else:
        yield f".. py:data:: {path}.{name}"
        yield f"   :value: {str(value).replace('typing.', '').replace('collections.abc.', '')}"
        yield ""
        yield f"   {docstrings.plain(constant_text(module, name), _places())}"
    yield ""


@cache
def _places() -> dict[str, str]:
    """Return the place of each public name in the index, the first one for an ambiguous name."""
    return {
        name: f"{home(getattr(MODULES[path], name), name)}.{name}" for path in reversed(MODULES) for name in names(path)
    }


def _docstring(app: Sphinx, kind: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """Convert docstrings from plain text before napoleon converts their sections."""
    lines[:] = docstrings.as_rest(lines, _places())


def _all_there(app: Sphinx, env: BuildEnvironment) -> None:
    """Warn about public names that no page documents."""
    here = env.domains.python_domain.objects
    for module in MODULES:
        for name in names(module):
            if f"{home(getattr(MODULES[module], name), name)}.{name}" not in here:
                logging.getLogger(__name__).warning("%s.%s is on no page of docs/reference", module, name)


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the directive, and the conversion of docstrings."""
    app.add_directive("public-names", PublicNames)
    app.connect("autodoc-process-docstring", _docstring, priority=400)
    app.connect("env-check-consistency", _all_there)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
