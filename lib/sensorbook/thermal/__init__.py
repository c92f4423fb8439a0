"""Thermal calibration: bias against temperature (A 5.3, 7.1)."""

from sensorbook.thermal.fit import fit_thermal
from sensorbook.thermal.model import ThermalModel
from sensorbook.thermal.result import ThermalAxis, ThermalFit
from sensorbook.thermal.sweep import Sweep, reduce_sweep

__all__ = ["Sweep", "ThermalAxis", "ThermalFit", "ThermalModel", "fit_thermal", "reduce_sweep"]
