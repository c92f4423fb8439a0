"""Figures; each takes results and an optional Axes and returns Axes."""
