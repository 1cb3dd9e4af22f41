"""Pure control code: controllers, stiffness estimate, frames, task, supervisor and figures of merit."""

from hil_bridge.control.analysis.merit import FiguresOfMerit, ForceTrace, figures_of_merit
from hil_bridge.control.analysis.tool_identification import ToolEstimate, ToolPose, identify_tool
from hil_bridge.control.controllers import CONTROLLERS, controller_kind, controller_names, make_controller
from hil_bridge.control.course.intent import Intent, Phase, Target
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.oscillation import OscillationDetector, OscillationState
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.course.peaks import Peaks
from hil_bridge.control.course.stroke import Stride, Stroke, StrokeState
from hil_bridge.control.course.supervisor import Supervisor
from hil_bridge.control.course.verdict import (
    Allow,
    Clamp,
    Observation,
    Request,
    Stop,
    SupervisorState,
    Verdict,
)
from hil_bridge.control.course.zero import Reading, lift_fault, reading, weight_fault, weight_reading
from hil_bridge.control.decision import Decision, LoopState, Proposal
from hil_bridge.control.geometry.frames import (
    force_along,
    quaternion_of,
    rotate,
    rotation_matrix,
    tool_gravity_wrench,
    transform_wrench,
)
from hil_bridge.control.geometry.wrist import Wrist, WristAtOrientation
from hil_bridge.control.laws.estimate import Gates, StiffnessEstimate
from hil_bridge.control.laws.fuzzy import (
    Inference,
    InferenceSystem,
    Surface,
    computed_matrix,
    evaluate,
    infer,
    quantise,
)
from hil_bridge.control.laws.fuzzy_control import (
    AdaptiveState,
    FuzzyAdaptive,
    FuzzyPi,
    FuzzyState,
    ResolutionAware,
    scheduled_gain,
)
from hil_bridge.control.laws.linear import Admittance, AdmittanceState, Pi, PiState
from hil_bridge.control.laws.predictive import Predictive, PredictiveState
from hil_bridge.control.laws.rules import PAPER_RULES, RuleBase, parse_rules, read_rules, rules_as_toml
from hil_bridge.control.laws.stiffness import Pairing, Stiffness
from hil_bridge.control.loop import ControlLoop
from hil_bridge.control.sample import Sample
from hil_bridge.control.types import Command, Controller, Measurement, numeric_explanation

__all__ = [
    "CONTROLLERS",
    "PAPER_RULES",
    "AdaptiveState",
    "Admittance",
    "AdmittanceState",
    "Allow",
    "Clamp",
    "Command",
    "ControlLoop",
    "Controller",
    "Decision",
    "FiguresOfMerit",
    "ForceTrace",
    "FuzzyAdaptive",
    "FuzzyPi",
    "FuzzyState",
    "Gates",
    "Inference",
    "InferenceSystem",
    "Intent",
    "Limits",
    "LoopState",
    "Measurement",
    "Observation",
    "OscillationDetector",
    "OscillationState",
    "Pairing",
    "Peaks",
    "Phase",
    "Pi",
    "PiState",
    "Predictive",
    "PredictiveState",
    "Proposal",
    "Reading",
    "Request",
    "ResolutionAware",
    "RuleBase",
    "Sample",
    "Stiffness",
    "StiffnessEstimate",
    "Stop",
    "Stride",
    "Stroke",
    "StrokeState",
    "Supervisor",
    "SupervisorState",
    "Surface",
    "Target",
    "TaskParameters",
    "ToolEstimate",
    "ToolPose",
    "Verdict",
    "Wrist",
    "WristAtOrientation",
    "computed_matrix",
    "controller_kind",
    "controller_names",
    "evaluate",
    "figures_of_merit",
    "force_along",
    "identify_tool",
    "infer",
    "lift_fault",
    "make_controller",
    "numeric_explanation",
    "parse_rules",
    "quantise",
    "quaternion_of",
    "read_rules",
    "reading",
    "rotate",
    "rotation_matrix",
    "rules_as_toml",
    "scheduled_gain",
    "tool_gravity_wrench",
    "transform_wrench",
    "weight_fault",
    "weight_reading",
]
