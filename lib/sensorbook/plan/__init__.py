"""How to record each kind for a wanted accuracy, from Cramér–Rao bounds and the rules of the chapters."""

from sensorbook.plan.kinds import DEFAULT_GRADE, KINDS, Usage, overview, plan
from sensorbook.plan.levels import GRADES
from sensorbook.plan.words import Plan

__all__ = ["DEFAULT_GRADE", "GRADES", "KINDS", "Plan", "Usage", "overview", "plan"]
