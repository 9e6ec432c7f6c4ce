"""A scene states presets: sets of overrides with a reason, taken by name before all other overrides."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

import graspfx as gx
from graspfx import environment, plugins
from graspfx.__main__ import main
from graspfx.errors import InputError, SceneError, UnknownNameError

BASE = (plugins.shelf("scenes") / "reference-1dof.toml").read_text(encoding="utf-8")
PRESETS = """
[preset.heavy]
reason = "a heavier object, which a lighter coupling moves"
set = { "object.mass" = 0.2, "finger.*.hand.stiffness" = 44.0 }

[preset.stiff]
reason = "a stiffer squeeze"

[preset.stiff.set]
"coupling.internal.stiffness" = 75.0
"""


def presets(name: str) -> list[str]:
    """Name the presets of a scene, also of one whose dynamics are not installed here."""
    path = plugins.source_of("scenes", name)
    if path is None or path.suffix != ".toml":
        return [*gx.load(name).preset]
    return [*tomllib.loads(path.read_text(encoding="utf-8")).get("preset", {})]


SHELF = [name for name, origin in plugins.names("scenes").items() if origin.startswith("GraspFX")]
PYTHON = f'''
import tomllib
import graspfx as gx

def scene(viscosity: float = 0.8) -> gx.Scene:
    table = tomllib.loads("""{BASE}{PRESETS}""")
    table["object"]["viscosity"] = viscosity
    return gx.Scene(**table)
'''


@pytest.fixture(autouse=True)
def folder(new_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv(environment.VARIABLE, raising=False)
    (tmp_path / "own.toml").write_text(BASE + PRESETS)
    (tmp_path / "own.py").write_text(PYTHON)
    return tmp_path


def stiffness(scene: gx.Scene) -> list[object]:
    return [finger.hand.stiffness for finger in scene.finger]  # type: ignore[union-attr]


def faults(text: str, preset: str | None = None) -> list[str]:
    """The faults of the scene with other presets, with their lines."""
    Path("wrong.toml").write_text(BASE + text)
    with pytest.raises(SceneError) as caught:
        gx.load("wrong.toml", preset=preset)
    return str(caught.value).splitlines()


def line(text: str, within: str) -> int:
    """The line on which a text first stands in the scene's file."""
    return (BASE + within).splitlines().index(text) + 1


@pytest.mark.parametrize("name", SHELF)
def test_every_preset_of_the_shelf_runs(name: str) -> None:
    stated = presets(name)
    assert name != "paper-waving" or "light-hand" in stated
    for preset in stated:
        scene = gx.load(name, preset=preset)
        assert scene.to_dict() != gx.load(name).to_dict()
        assert len(scene.preset[preset].reason.split()) >= 4
        rec = gx.run(scene, duration=2 * scene.period)
        assert len(rec) == 2 and not rec.faults


@pytest.mark.parametrize("file", ["own.toml", "own.py"])
def test_a_preset_replaces_values(file: str) -> None:
    plain, heavy = gx.load(file), gx.load(file, preset="heavy")
    assert (plain.object[0].mass, stiffness(plain)) == (0.1, [33.0, 33.0])
    assert (heavy.object[0].mass, stiffness(heavy)) == (0.2, [44.0, 44.0])
    assert heavy.source.preset == "heavy"
    assert heavy.source.changes == {"object.mass": 0.2, "finger.*.hand.stiffness": 44.0}
    assert gx.load(file, preset="stiff").coupling.internal.stiffness == 75.0


@pytest.mark.parametrize("file", ["own.toml", "own.py"])
def test_overrides_come_after_the_preset(file: str) -> None:
    scene = gx.load(file, {"finger.0.hand.stiffness": 50.0, "object.mass": 0.3}, preset="heavy")
    assert (scene.object[0].mass, stiffness(scene)) == (0.3, [50.0, 44.0])
    whole = {**scene.to_dict()["finger"][0]["hand"], "stiffness": 20.0}
    assert stiffness(gx.load(file, {"finger.*.hand": whole}, preset="heavy")) == [20.0, 20.0]
    assert list(scene.source.changes) == ["finger.*.hand.stiffness", "finger.0.hand.stiffness", "object.mass"]


def test_a_key_that_the_preset_replaces_later_is_the_override_s() -> None:
    Path("own.toml").write_text(
        BASE + '[preset.order]\nreason = "one, then all"\n'
        'set = { "finger.0.hand.stiffness" = 1.0, "finger.*.hand.stiffness" = 2.0 }\n'
    )
    assert stiffness(gx.load("own.toml", preset="order")) == [2.0, 2.0]
    assert stiffness(gx.load("own.toml", {"finger.0.hand.stiffness": 3.0}, preset="order")) == [3.0, 2.0]


def test_a_parameter_of_a_python_scene_goes_with_a_preset() -> None:
    scene = gx.load("own.py", {"viscosity": 1.5}, preset="heavy")
    assert (scene.object[0].viscosity, scene.object[0].mass) == (1.5, 0.2)


def test_a_scene_without_its_presets_has_the_same_bits() -> None:
    Path("plain.toml").write_text(BASE)
    assert np.array_equal(gx.run(gx.load("own.toml")).rows, gx.run(gx.load("plain.toml")).rows, equal_nan=True)


def test_a_replaced_scene_keeps_its_preset() -> None:
    scene = gx.load("own.toml", preset="heavy").replace({"object.viscosity": 2.0})
    assert (scene.object[0].mass, scene.source.preset) == (0.2, "heavy")
    assert scene.source.changes["object.viscosity"] == 2.0


def test_an_unknown_preset_gets_a_close_match() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown preset 'heavi'; did you mean 'heavy'\? \(known: heavy, stiff"):
        gx.load("own.toml", preset="heavi")
    with pytest.raises(UnknownNameError, match=r"unknown preset 'heavy'; .*knob.toml has no presets"):
        gx.load("knob", preset="heavy")
    with pytest.raises(InputError, match="preset: given 3"):
        gx.load("own.toml", preset=3)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "place", "message"),
    [
        ('reasn = "x"\nset = { "object.mass" = 0.2 }', 'reasn = "x"', "preset.a.reasn: unknown key; did you mean 'rea"),
        ('reason = " "\nset = { "object.mass" = 0.2 }', 'reason = " "', "preset.a.reason: expected a sentence"),
        ('reason = "x"\nset = {}', "set = {}", "preset.a.set: expected values by dotted key"),
        ('reason = "x"\nset = [1]', "set = [1]", "preset.a.set: expected values by dotted key"),
        ('reason = "x"', "[preset.a]", "preset.a.set: required, but not given"),
        ('reason = "x"\nset = { "preset.b.reason" = "y" }', None, "preset.a.set: expected values of the scene;"),
        ('reason = "x"\nset = { "object.mass" = 1979-05-27 }', None, "preset.a.set: expected finite numbers, text"),
        ('reason = "x"\nset = { "object.mass" = nan }', None, "preset.a.set: expected finite numbers, text"),
    ],
)  # fmt: skip
def test_a_preset_that_is_not_well_formed_has_its_line(text: str, place: str | None, message: str) -> None:
    within = f"[preset.a]\n{text}\n"
    at = line(place or text.splitlines()[-1], within)
    found = faults(within)
    assert len(found) == 1
    assert found[0].startswith(f"wrong.toml:{at}: {message}")
    assert found == faults(within, "a")


def test_a_name_that_no_preset_can_have() -> None:
    head = '[preset."a b"]'
    [text] = faults(head + '\nreason = "x"\nset = { "object.mass" = 0.2 }\n')
    assert text.startswith(f"wrong.toml:{line(head, head)}: preset.a b: expected a name of letters")


WRONG = """\
[preset.wrong]
reason = "each of its values is wrong"

[preset.wrong.set]
"object.mass" = -1.0
"object.viscosty" = 1.0
"finger.7.start" = [0.0]
"finger.*.hand.damping" = "much"
"""


def test_values_of_a_preset_have_their_lines_where_it_is_taken() -> None:
    assert gx.load("own.toml").preset.keys() == {"heavy", "stiff"}
    said = faults(WRONG, "wrong")
    expected = {
        '"object.mass" = -1.0': "object.mass: expected more than 0; given -1.0",
        '"object.viscosty" = 1.0': "object.viscosty: unknown key",
        '"finger.7.start" = [0.0]': "finger.7.start: finger has 2 entries; the last is finger.1",
        '"finger.*.hand.damping" = "much"': "finger.0.hand.damping: expected a number; given 'much'",
    }
    for text, message in expected.items():
        mine = [each for each in said if each.startswith(f"wrong.toml:{line(text, WRONG)}: {message}")]
        assert len(mine) == 1, (message, said)
        assert mine[0].endswith("(set by preset 'wrong')")
    assert len(said) == 5  # damping of both fingers


def test_an_override_s_fault_is_the_override_s() -> None:
    with pytest.raises(SceneError, match=r"^own.toml: object.mass: expected more than 0; given -2.0 \(set by an over"):
        gx.load("own.toml", {"object.mass": -2.0}, preset="heavy")


def test_a_check_takes_every_preset_of_the_scene() -> None:
    Path("wrong.toml").write_text(BASE + WRONG)
    assert gx.load("wrong.toml").preset["wrong"].set["object.mass"] == -1.0  # nobody has asked for it
    report = gx.check("wrong.toml")
    assert report.verdict.startswith("not judged: 5 faults")
    assert {fault.line for fault in report.faults} == {line(text, WRONG) for text in WRONG.splitlines()[4:]}
    table = gx.load("wrong.toml").to_dict()
    assert len(gx.check(gx.Scene(**table)).faults) == 5
    assert not gx.check("wrong.toml", {"object.mass": 0.2}).faults  # of the scene with a change presets are not asked


def test_a_check_finds_what_only_the_whole_scene_shows() -> None:
    text = '[preset.far]\nreason = "no arm reaches there"\nset = { "finger.0.start" = [9.0, 0.0] }\n'
    whole = (plugins.shelf("scenes") / "paper-waving.toml").read_text(encoding="utf-8") + text
    Path("far.toml").write_text(whole)
    report = gx.check("far.toml")
    at = whole.splitlines().index(text.splitlines()[-1]) + 1
    assert [fault.line for fault in report.faults] == [at]
    assert report.faults[0].message.endswith("(set by preset 'far')")


def test_a_preset_is_not_trusted_as_an_override_is(folder: Path) -> None:
    elsewhere = folder.parent / "driver_of_a_preset.py"
    elsewhere.write_text("open('ran', 'a').close()\n")
    text = f'[preset.else]\nreason = "a driver from elsewhere"\nset = {{ "finger.0.device.name" = "{elsewhere}" }}\n'
    said = faults(text, "else")
    assert any("outside of the scene's folder" in each for each in said)
    assert not Path("ran").exists()


def test_commands_take_a_preset(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "own.toml", "--preset", "heavy", "--no-figure", "--duration", "0.05", "--out", "out"]) == 0
    header = gx.Recording.load("out").header
    assert (header.preset, header.overrides) == ("heavy", {"object.mass": 0.2, "finger.*.hand.stiffness": 44.0})
    assert main(["run", "own.toml", "--preset", "hevy"]) == 2
    assert "did you mean 'heavy'?" in capsys.readouterr().err
    assert main(["check", "own.toml", "--preset", "heavy", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["preset"], list(answer["presets"])) == ("heavy", ["heavy", "stiff"])
    assert main(["check", "own.toml"]) == 0
    lines = [text for text in capsys.readouterr().out.splitlines() if text.startswith("preset")]
    assert lines == [
        "preset   heavy                   a heavier object, which a lighter coupling moves",
        "preset   stiff                   a stiffer squeeze",
    ]
    for words in (["stability"], ["picture", "--time", "0.01"], ["warmup"]):
        assert main([words[0], "own.toml", "--preset", "stiff", *words[1:]]) == 0
    assert main(["picture", "out", "--preset", "stiff"]) == 2
    assert "is a recording" in capsys.readouterr().err
    assert main(["list"]) == 0
    assert f"--preset light-hand: {gx.load('paper-waving').preset['light-hand'].reason}" in capsys.readouterr().out


def test_the_cache_tells_presets_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    from graspfx.assembly.scene_cache import cached, place

    def execute(*words: str) -> gx.Recording:
        assert main(["run", "own.toml", "--no-figure", "--duration", "0.05", "--overwrite", "--out", "o", *words]) == 0
        return gx.Recording.load("o")

    plain, first = execute(), execute("--preset", "heavy")
    where = place("own.toml", {}, "heavy")
    assert where is not None
    entry = cached(where)
    assert entry is not None
    assert entry[0].source.changes == gx.load("own.toml", preset="heavy").source.changes
    again = execute("--preset", "heavy")
    assert np.array_equal(first.rows, again.rows, equal_nan=True)
    assert not np.array_equal(first.rows, plain.rows, equal_nan=True)
    assert again.header.overrides == first.header.overrides
    assert again.header.preset == "heavy"
    assert np.array_equal(execute().rows, plain.rows, equal_nan=True)
