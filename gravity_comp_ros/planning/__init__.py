"""Experiment design: motions that resolve the open findings of earlier recordings."""

from gravity_comp_ros.planning.expected import Expectation, Plan, PlannedPart
from gravity_comp_ros.planning.options import PlanOptions, Target
from gravity_comp_ros.planning.plan import plan

__all__ = ['Expectation', 'Plan', 'PlanOptions', 'PlannedPart', 'Target', 'plan']
