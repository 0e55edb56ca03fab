"""
Gravity compensation for robot arms, learned from recorded joint states.

    import gravity_comp_ros as gc
    data = gc.read(["run1.mcap", "run2.mcap"])   # or gc.Recording.from_arrays(q, tau, t)
    train, test = data.split(0.2)
    model = gc.fit(train)
    print(gc.compare(model, test))               # error of every joint, N·m
    diagnosis = gc.diagnose(train, model)        # which physical effect is missing
    model = gc.add_effects(model, train, diagnosis.findings)
    print(gc.compare(model, test))
    model = gc.update(model, gc.read("tool.mcap"))   # after a payload change
    model.save("arm.json")

Arrays are NumPy arrays of M samples and N joints, shape (M, N), in rad, rad/s and N·m. Results
have typed fields and print as tables, in a terminal and in a notebook. Errors caused by data or
options derive from `GravityCompError`; the message names the cause and its location.
"""

from importlib import import_module
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from gravity_comp_ros.api.loop import add_effects as add_effects
    from gravity_comp_ros.api.loop import compare as compare
    from gravity_comp_ros.api.loop import diagnose as diagnose
    from gravity_comp_ros.api.loop import fit as fit
    from gravity_comp_ros.api.loop import plan as plan
    from gravity_comp_ros.api.loop import update as update
    from gravity_comp_ros.api.model import load as load
    from gravity_comp_ros.api.model import Model as Model
    from gravity_comp_ros.api.read import read as read
    from gravity_comp_ros.api.recording import Recording as Recording
    from gravity_comp_ros.data.gate import GateOptions as GateOptions
    from gravity_comp_ros.diagnosis.findings import Diagnosis as Diagnosis
    from gravity_comp_ros.diagnosis.findings import Finding as Finding
    from gravity_comp_ros.diagnosis.findings import Verdict as Verdict
    from gravity_comp_ros.errors import GravityCompError as GravityCompError
    from gravity_comp_ros.evaluation.compare import Comparison as Comparison
    from gravity_comp_ros.planning.expected import MotionPlan as MotionPlan
    from gravity_comp_ros.planning.workspace import PlanOptions as PlanOptions

__version__ = '0.1.0'

# Module of each public name. Modules are imported at the first access to one of their names, so
# that `import gravity_comp_ros` is fast and the node loads only the modules that it uses.
_MODULES = {
    'read': 'api.read', 'Recording': 'api.recording', 'GateOptions': 'data.gate',
    'fit': 'api.loop', 'compare': 'api.loop', 'diagnose': 'api.loop',
    'add_effects': 'api.loop', 'update': 'api.loop', 'plan': 'api.loop',
    'load': 'api.model', 'Model': 'api.model',
    'Comparison': 'evaluation.compare', 'Diagnosis': 'diagnosis.findings',
    'MotionPlan': 'planning.expected', 'PlanOptions': 'planning.workspace',
    'Finding': 'diagnosis.findings', 'Verdict': 'diagnosis.findings',
    'GravityCompError': 'errors',
}
__all__ = ['add_effects', 'compare', 'Comparison', 'diagnose', 'Diagnosis', 'Finding', 'fit',
           'GateOptions', 'GravityCompError', 'load', 'Model', 'MotionPlan', 'plan',
           'PlanOptions', 'read', 'Recording', 'update', 'Verdict']


def __getattr__(name: str) -> Any:
    """Return a public name; its module is imported at the first access (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    value = getattr(import_module(f'{__name__}.{_MODULES[name]}'), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names, including those not yet imported."""
    return sorted({*globals(), *__all__})
