"""Importing GraspFX is light: public names load when they are first used, and a run loads what its scene names."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import graspfx

ROOT = Path(__file__).parents[2]
HEAVY = {"h5py", "llvmlite", "matplotlib", "pybullet", "pydantic", "rich", "scipy", "tree_sitter", "trimesh"}


def third_party_after(code: str, cwd: Path = ROOT) -> set[str]:
    """The top-level packages, beyond Python's own and what the environment loads at start, that code imports."""
    program = (
        f"import sys; sys.path.insert(0, {str(ROOT)!r}); before = set(sys.modules)\n{code}\n"
        "late = {name.partition('.')[0] for name in set(sys.modules) - before} - sys.stdlib_module_names\n"
        "late = {name for name in late if not name.startswith('_') and name != 'cython_runtime'}\n"
        "print('\\n' + ' '.join(sorted(late)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=cwd)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.splitlines()[-1].split())


def test_importing_the_package_loads_numpy_at_most() -> None:
    assert third_party_after("import graspfx") - {"numpy"} == {"graspfx"}


def test_the_framework_names_no_driver_and_no_scene() -> None:
    """The import contracts see the shelves as `devices` and `scenes` only, not under the package's name."""
    for file in sorted((ROOT / "graspfx").rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.module:
                modules = [f"{node.module}.{alias.name}" for alias in node.names]
            shelves = [each for each in modules if re.match(r"(graspfx\.)?(devices|scenes)", each)]
            assert not shelves, file


def test_drivers_load_no_test_code() -> None:
    """What runs on hardware comes by neither the conformance kit nor an emulator, which stand in the same folders."""
    code = (
        "import sys; from graspfx import plugins\n"
        "for name in plugins.names('devices'): plugins.load('devices', name)\n"
        "print([each for each in sys.modules if 'testing' in each.split('.')[1:2] or each.endswith('.emulator')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.stdout == "[]\n", done.stderr


def test_a_name_that_does_not_exist_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'grasp_matirx'"):
        _ = graspfx.grasp_matirx


def test_type_checkers_see_the_names_that_users_get() -> None:
    """The imports under TYPE_CHECKING and the table that loads the names say the same."""
    source = ast.parse(Path(graspfx.__file__).read_text(encoding="utf-8"))
    guarded = [node for branch in source.body if isinstance(branch, ast.If) for node in branch.body]
    seen = {
        alias.name: f"{node.module}.{alias.name}" if node.module == "graspfx" else node.module
        for node in guarded
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert seen == graspfx._HOMES
    assert {*seen, "__version__"} == set(graspfx.__all__)


def test_the_mathematics_needs_neither_files_nor_pictures() -> None:
    loaded = third_party_after("import graspfx as gx; gx.grasp_matrix, gx.Split, gx.Coupling, gx.unilateral_force")
    assert not loaded & (HEAVY - {"scipy"})


RUN = "main(['run', 'reference-1dof', '--duration', '0.1', '--out', 'out', '--no-figure', '--overwrite'])"
CHECKS = {"annotated_types", "pydantic", "pydantic_core", "typing_extensions", "typing_inspection"}


@pytest.mark.parametrize(
    ("arguments", "allowed"),
    [
        ("--help", set()),
        ("list", set()),
        ("schema", CHECKS | {"numpy"}),
        ("run reference-1dof --no-figure --duration 0.1", CHECKS | {"numpy", "h5py", "llvmlite"}),
    ],
)
def test_what_each_command_may_load(arguments: str, allowed: set[str], tmp_path: Path) -> None:
    """Beyond these, none: each package costs a start tens of milliseconds."""
    loaded = third_party_after(
        "from graspfx.__main__ import main\n"
        "import contextlib\n"
        f"with contextlib.suppress(SystemExit): main({arguments.split()!r})",
        cwd=tmp_path,
    )
    assert loaded - {"graspfx"} <= allowed


def test_the_second_run_of_a_scene_loads_nothing_that_checks_it_or_is_slow_to_load(
    new_cache: Path, tmp_path: Path
) -> None:
    """`reference-1dof` has no PyBullet body, no mesh and here no figure; llvmlite loads the code that runs."""
    code = f"from graspfx.__main__ import main\nassert {RUN} == 0"
    assert "pydantic" in third_party_after(code, cwd=tmp_path)
    code += "\nassert not {'numpy.ma', 'email', 'importlib.metadata'} & {*sys.modules}"
    assert third_party_after(code, cwd=tmp_path) == {"graspfx", "numpy", "h5py", "llvmlite"}


@pytest.mark.parametrize(("scene", "has_file"), [("mug", True), ("thin-plate", True), ("prism", False)])
def test_the_second_run_of_a_scene_with_a_mesh_loads_nothing_that_reads_or_weighs_it(
    scene: str, has_file: bool, new_cache: Path, tmp_path: Path
) -> None:
    """Neither trimesh, which reads files, nor scipy, which finds a hull; of a scene in Python pydantic stays."""
    run = f"main(['run', {scene!r}, '--duration', '0.02', '--no-figure'])"
    code = f"from graspfx.__main__ import main\nassert {run} == 0"
    assert ("trimesh" in third_party_after(code, cwd=tmp_path)) == has_file
    assert not {"trimesh", "scipy", "matplotlib"} & third_party_after(code, cwd=tmp_path)


def test_help_costs_less_than_importing_numpy() -> None:
    """About 0.04 s against 0.1 s; the ratio is what holds on any machine."""
    resource = pytest.importorskip("resource", reason="CPU time of a child process is measured by Unix")

    def cpu(*arguments: str) -> float:
        def spent() -> float:
            usage = resource.getrusage(resource.RUSAGE_CHILDREN)
            return float(usage.ru_utime + usage.ru_stime)

        before = spent()
        subprocess.run([sys.executable, *arguments], check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
        return spent() - before

    assert min(cpu("-m", "graspfx", "--help") for _ in range(3)) < min(cpu("-c", "import numpy") for _ in range(3))
