"""What a new user stumbles over: wrong names, files that are cut short, and what is said first."""

from __future__ import annotations

import copy
import pickle
import warnings
from pathlib import Path
from typing import Any

import pytest

import graspfx as gx
from graspfx.__main__ import main
from graspfx.errors import InputError

UNEQUAL = {"coupling.internal.stiffness": [70.0, 30.0], "coupling.external.stiffness": [10.0, 100.0]}
LINE = [[-0.02, 0.0, 0.0], [0.02, 0.0, 0.0]]
INWARD = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ("forces", "finger_force"),
        ("positions", "finger_position"),
        ("finger_forze", "finger_force"),
        ("times", "time"),
        ("orientation", r"objects\[name\].orientation"),
        ("penetration", "gap"),
        ("dt", "header.period"),
    ],
)
def test_a_wrong_attribute_of_a_recording_suggests_the_right_one(wrong: str, right: str) -> None:
    recording = gx.run("reference-1dof", duration=0.02)
    with pytest.raises(AttributeError, match=f"a recording has no '{wrong}'; did you mean {right}"):
        getattr(recording, wrong)
    assert not hasattr(recording, wrong)


def test_a_recording_says_who_reads_files_and_is_copied_as_before() -> None:
    for arguments in (("run.h5",), (Path("run.h5"),), ()):
        with pytest.raises(InputError, match=r"gx\.Recording\.load\(path\) reads a file"):
            gx.Recording(*arguments)
    recording = gx.run("reference-1dof", duration=0.02)
    for other in (copy.copy(recording), copy.deepcopy(recording), pickle.loads(pickle.dumps(recording))):
        assert other.rows.tobytes() == recording.rows.tobytes()


def line_of(call: Any) -> tuple[str, int]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        call()
    assert caught
    return Path(caught[0].filename).name, caught[0].lineno - call.__code__.co_firstlineno


@pytest.mark.parametrize(
    "call",
    [
        lambda: gx.run("reference-1dof", 0.02),
        lambda: gx.run("reference-1dof", UNEQUAL, duration=0.02),
        lambda: gx.check("reference-1dof", UNEQUAL),
        lambda: gx.certify(gx.load("reference-1dof", UNEQUAL)),
        lambda: gx.Grasp(LINE, normals=INWARD, model="soft").split(),
    ],
    ids=["duration", "run", "check", "certify", "split"],
)
def test_warnings_point_at_the_callers_line(call: Any) -> None:
    assert line_of(call) == (Path(__file__).name, 0)


@pytest.mark.parametrize(
    ("alias", "model"),
    [("PCWF", "hard"), ("HF", "hard"), ("SF", "soft"), ("FPC", "frictionless"), ("PwoF", "frictionless")],
)
def test_contact_models_have_the_names_of_the_literature(alias: str, model: str) -> None:
    grasp = gx.Grasp(LINE, normals=INWARD, model=alias)
    assert grasp.contacts.models == (model, model)
    assert (grasp.matrix == gx.Grasp(LINE, normals=INWARD, model=model).matrix).all()
    assert gx.Grasp(LINE, normals=INWARD, model=[alias, "hard"]).contacts.models == (model, "hard")


def test_without_a_command_the_help_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main([])
    printed = capsys.readouterr()
    assert end.value.code == 0 and "simulate a scene" in printed.out and not printed.err


def test_calibrate_says_first_that_there_is_no_hardware(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "paper-waving"]) == 2
    assert "expected a scene with hardware" in capsys.readouterr().err


def test_a_picture_goes_into_a_folder(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    for folder in ("there", "new/"):
        assert main(["picture", "paper-spring", "--time", "0.01", "--out", f"{tmp_path / folder}/"]) == 0
        assert (tmp_path / folder / "picture.png").is_file()


@pytest.mark.parametrize("share", [0.5, 0.1])
@pytest.mark.parametrize("kind", ["stl", "stl_ascii"])
def test_a_truncated_stl_is_said_to_be_truncated(kind: str, share: float, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    data = trimesh.creation.icosphere(subdivisions=1, radius=0.03).export(file_type=kind)
    whole = data if isinstance(data, bytes) else data.encode()
    table = gx.load("sphere-three-fingers").to_dict()
    table["object"] = [{**table["object"][0], "shape": {"mesh": str(tmp_path / "ball.stl")}}]
    for content, truncated in ((whole, False), (whole[: int(share * len(whole))], True)):
        (tmp_path / "ball.stl").write_bytes(content)
        if truncated:
            with pytest.raises(gx.errors.SceneError, match="it is truncated"):
                gx.Scene(**table)
        else:
            gx.Scene(**table)
