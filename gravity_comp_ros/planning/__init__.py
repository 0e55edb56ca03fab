"""Experiment design: motions that resolve the open findings of earlier recordings."""

from gravity_comp_ros.planning.expected import Expectation, MotionPlan, PlannedPart
from gravity_comp_ros.planning.plan import plan
from gravity_comp_ros.planning.workspace import PlanOptions

__all__ = ['Expectation', 'MotionPlan', 'PlanOptions', 'PlannedPart', 'plan']
