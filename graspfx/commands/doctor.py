"""graspfx doctor: test whether this machine, and a device or the hardware of a scene, can run a real-time loop."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspfx.commands.arguments import add_options, add_overrides
from graspfx.commands.destination import add_destination, name_files, require_room
from graspfx.commands.output import REFUSED, SUCCESS, is_quiet, note, print_json
from graspfx.errors import InputError
from graspfx.machine.system_checks import Finding, machine_kind, system_findings
from graspfx.progress import waiting
from graspfx.recording.files import placing

if TYPE_CHECKING:
    from graspfx.loop.device import Features
    from graspfx.loop.servo_parts import DeviceWiring

EXAMPLE = """  graspfx doctor haply-2diy --set port=/dev/ttyACM0 --period 0.001"""
PERIOD = 0.001  # [s]


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument(
        "subject", metavar="DEVICE_OR_SCENE", nargs="?", help="name of a driver, or a scene whose hardware is opened"
    )
    add_options(
        parser,
        ("--period S", "period of the loop [s] (default: the scene's, or 0.001)", float),
        ("--json", "print the findings as JSON only"),
    )
    add_destination(parser, "FILE", "file of a report to share; it contains neither ports nor this machine's name")
    add_overrides(parser)


def execute(options: Namespace) -> int:
    if options.period is not None and not 1e-5 <= options.period <= 1.0:
        raise InputError("--period", options.period, "a period from 1e-5 to 1 s")
    if options.out is not None:
        require_room(options, [options.out])
    subject = _Subject(options)
    findings = list(system_findings())
    with waiting("measuring wake-up times for three seconds"):
        from graspfx.machine import timing_checks

        findings += timing_checks.Jitter(subject.period, timing_checks.WAKE_DURATION).findings()
    if subject.stations:
        if not options.json:
            note([f"opening {', '.join(name for name, _ in subject.features)} at zero force: do not move the handles"])
        findings += subject.round_trips()
    if options.out is not None:
        from graspfx.machine.system_checks import lab_report

        with placing(options.out) as file:
            file.write_text(lab_report(machine_kind(), findings, subject.features, subject.settings))
    if options.json:
        print_json([{"subject": f.subject, "text": f.text, "ok": f.ok, "remedy": f.remedy} for f in findings])
    else:
        print(*_lines(findings), sep="\n")
        name_files([options.out] if options.out is not None else [])
    return SUCCESS if all(each.ok for each in findings) else REFUSED


class _Subject:
    """Hardware to test: that of a driver or of a scene, or none. Devices are connected but not opened."""

    def __init__(self, options: Namespace) -> None:
        self.period = options.period or PERIOD
        self.stations: list[DeviceWiring] = []
        self.features: list[tuple[str, Features]] = []
        self.settings: list[object] = []
        self.names: list[str] = []
        if options.subject is not None:
            from graspfx.plugins import names

            settings = dict(options.overrides)
            if options.subject in names("devices"):
                self._add_device(options.subject, settings)
            else:
                self._add_scene(options, settings)

    def _add_device(self, name: str, settings: dict[str, Any]) -> None:
        from inspect import Parameter, signature

        import numpy as np

        from graspfx import plugins
        from graspfx.assembly.checks.settings import signature_faults
        from graspfx.assembly.wiring import AUTOMATIC
        from graspfx.loop.device import is_hardware
        from graspfx.loop.servo_parts import DeviceWiring

        driver = plugins.load("devices", name)
        parameters = signature(driver.connect).parameters
        if AUTOMATIC in parameters and parameters[AUTOMATIC].default is Parameter.empty:
            settings.setdefault(AUTOMATIC, 2)
        for place, text in signature_faults((), name, settings, parameters, {AUTOMATIC}):
            raise InputError(".".join(map(str, place)), settings.get(str(place[0])), f"a setting of {name!r}", text)
        device = driver.connect(**settings)
        if not is_hardware(device):
            raise InputError("device", name, "a driver of hardware; a simulated device needs no test")
        self.names = [f"channel{i}" for i in range(device.features.fingers)]
        self.stations = [DeviceWiring(device, np.arange(device.features.fingers))]
        self._note(name, device.features, settings)

    def _add_scene(self, options: Namespace, settings: dict[str, Any]) -> None:
        from graspfx.assembly.resolve import resolve
        from graspfx.assembly.wiring import table_at
        from graspfx.loop.device import is_hardware
        from graspfx.loop.servo_parts import DeviceWiring
        from graspfx.scene.load import load

        scene = load(options.subject, settings, preset=options.preset)
        self.period, self.names = options.period or scene.period, list(scene.finger_names)
        for wire in resolve(scene).own_wires():
            if is_hardware(wire.device):
                table = table_at(scene, int(wire.used[0]))[1]
                self.stations.append(DeviceWiring(wire.device, wire.fingers, wire.fitting))
                self._note(table.name, wire.features, table.settings)
        if not self.stations:
            raise InputError("scene", options.subject, "a scene with hardware; simulated devices need no test")

    def _note(self, name: str, features: Features, settings: dict[str, Any]) -> None:
        label = Path(name).stem if name.endswith(".py") else name
        self.features.append((label, features))
        self.settings += [each for each in (name, *settings.values()) if isinstance(each, str) and each != label]
        self.settings += [str(value) for key, value in settings.items() if key in ("serial", "device", "port", "url")]

    def round_trips(self) -> Iterator[Finding]:
        from graspfx.machine.timing_checks import round_trip_findings

        return round_trip_findings(self.stations, self.names, self.period)


def _lines(findings: list[Finding]) -> Iterator[str]:
    width = max(len(each.subject) for each in findings)
    for each in findings:
        if not (each.ok and is_quiet()):
            yield f"{'ok' if each.ok else 'NO':<3} {each.subject:<{width}}  {each.text}"
        if not each.ok:
            yield f"{'':<3} {'':<{width}}  -> {each.remedy}"
