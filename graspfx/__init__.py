"""Haptic display of grasping, with separate coupling impedances for internal and external forces."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from graspfx import errors as errors
    from graspfx import experiment as experiment
    from graspfx import protocols as protocols
    from graspfx import testing as testing
    from graspfx.analysis import passivity as passivity
    from graspfx.analysis import stability as stability
    from graspfx.assembly.real_time_session import RealTimeSession as RealTimeSession
    from graspfx.assembly.replay_recording import replay as replay
    from graspfx.assembly.run_scene import open as open
    from graspfx.assembly.run_scene import run as run
    from graspfx.assembly.session import Session as Session
    from graspfx.batch.batch import Batch as Batch
    from graspfx.batch.batch import run_batch as run_batch
    from graspfx.certificate.certify import Certificates as Certificates
    from graspfx.certificate.certify import certify as certify
    from graspfx.certificate.certify_operators import OperatorCertificate as OperatorCertificate
    from graspfx.certificate.certify_operators import certify_operators as certify_operators
    from graspfx.certificate.report import Report as Report
    from graspfx.certificate.report import check as check
    from graspfx.feedback.feedback import Feedback as Feedback
    from graspfx.grasp.grasp import Grasp as Grasp
    from graspfx.grasp.impedance import Coupling as Coupling
    from graspfx.grasp.impedance import Impedance as Impedance
    from graspfx.grasp.matrix import grasp_matrix as grasp_matrix
    from graspfx.grasp.object_impedance import ObjectImpedance as ObjectImpedance
    from graspfx.grasp.point_coupling import PointCoupling as PointCoupling
    from graspfx.grasp.quality.least_friction import least_friction as least_friction
    from graspfx.grasp.split import Split as Split
    from graspfx.grasp.split import divide as divide
    from graspfx.grasp.unilateral_force import unilateral_force as unilateral_force
    from graspfx.recording.record import Recording as Recording
    from graspfx.scene.load import load as load
    from graspfx.scene.model import Scene as Scene
    from graspfx.show import style as style
    from graspfx.sweeps.run_sweep import sweep as sweep
    from graspfx.sweeps.sweep_result import SweepResult as SweepResult
    from graspfx.tuning.tune_scene import tune as tune
    from graspfx.tuning.tuning import Tuning as Tuning

__version__ = "0.1.0"

_HOMES = {  # the module of each public name, or its package; in the order in which a reader meets the names
    "grasp_matrix": "graspfx.grasp.matrix",
    "Grasp": "graspfx.grasp.grasp",
    "Split": "graspfx.grasp.split",
    "divide": "graspfx.grasp.split",
    "Impedance": "graspfx.grasp.impedance",
    "ObjectImpedance": "graspfx.grasp.object_impedance",
    "Coupling": "graspfx.grasp.impedance",
    "PointCoupling": "graspfx.grasp.point_coupling",
    "unilateral_force": "graspfx.grasp.unilateral_force",
    "least_friction": "graspfx.grasp.quality.least_friction",
    "Feedback": "graspfx.feedback.feedback",
    "Scene": "graspfx.scene.model",
    "load": "graspfx.scene.load",
    "run": "graspfx.assembly.run_scene",
    "Recording": "graspfx.recording.record",
    "replay": "graspfx.assembly.replay_recording",
    "open": "graspfx.assembly.run_scene",
    "RealTimeSession": "graspfx.assembly.real_time_session",
    "Session": "graspfx.assembly.session",
    "check": "graspfx.certificate.report",
    "Report": "graspfx.certificate.report",
    "run_batch": "graspfx.batch.batch",
    "Batch": "graspfx.batch.batch",
    "sweep": "graspfx.sweeps.run_sweep",
    "SweepResult": "graspfx.sweeps.sweep_result",
    "certify": "graspfx.certificate.certify",
    "Certificates": "graspfx.certificate.certify",
    "certify_operators": "graspfx.certificate.certify_operators",
    "OperatorCertificate": "graspfx.certificate.certify_operators",
    "tune": "graspfx.tuning.tune_scene",
    "Tuning": "graspfx.tuning.tuning",
    "stability": "graspfx.analysis",
    "passivity": "graspfx.analysis",
    "experiment": "graspfx.experiment",
    "testing": "graspfx.testing",
    "style": "graspfx.show",
    "protocols": "graspfx.protocols",
    "errors": "graspfx.errors",
}

__all__ = [*_HOMES, "__version__"]


def __getattr__(name: str) -> object:
    """Import the public attribute `name` of the package at its first use."""
    if name not in _HOMES:
        raise AttributeError(f"module 'graspfx' has no attribute {name!r}")
    home = _HOMES[name]
    module = import_module(home)
    if home == f"graspfx.{name}":
        value = module
    elif hasattr(module, name):
        value = getattr(module, name)
    else:
        value = import_module(f"{home}.{name}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)


# In a checkout, devices/ and scenes/ are next to the package: add the checkout's root to the package's path.
if not (Path(__file__).parent / "devices").is_dir():
    __path__.append(str(Path(__file__).parents[1]))
