"""Motions that settle what recordings leave open."""

from gravity_comp_ros.planning.options import PlanOptions, Target
from gravity_comp_ros.planning.plan import Expectation, Plan, plan, PlannedPart

__all__ = ['Expectation', 'Plan', 'PlanOptions', 'PlannedPart', 'Target', 'plan']
