"""Report folders of many synthetic devices, as large as real ones."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

CENTRES = {  # SI: worst-axis centre of a model's quantities
    "gyroscope": {"random_walk": (8.7e-5, 3e-4), "bias_instability": (4e-5, 1.5e-4)},
    "accelerometer": {"random_walk": (1.5e-3, None), "bias_instability": (9e-4, None)},
}
UNITS = {"gyroscope": ("rad/s/sqrt(Hz)", "rad/s"), "accelerometer": ("m/s^2/sqrt(Hz)", "m/s^2")}


def write_tree(root: Path, count: int, rng, models=("IMU-A", "IMU-B"), padding: int = 0) -> None:
    """`count` results.json below `root`; device k fails where k % 50 == 7, k % 97 == 5 is far out.

    `padding` adds so many numbers a sensor, as the curves of a real report do.
    """
    for k in range(count):
        folder = root / f"unit-{k:05d}"
        folder.mkdir(parents=True)
        (folder / "results.json").write_text(json.dumps(result(k, rng, models, padding)))


def result(k: int, rng, models=("IMU-A", "IMU-B"), padding: int = 0) -> dict:
    sensors, checks = {}, []
    for sensor, quantities in CENTRES.items():
        noise = {axis: {"random_walk": None, "bias_instability": None} for axis in "xyz"}
        for (quantity, (centre, limit)), unit in zip(
            quantities.items(), UNITS[sensor], strict=True
        ):
            for axis in "xyz":
                value = centre * float(np.exp(rng.normal(0, 0.06)))
                if k % 50 == 7 and axis == "y" and limit:
                    value = 1.4 * limit
                if k % 97 == 5 and axis == "x" and not limit:
                    value *= 3
                low, high = value * 0.97, value * 1.03
                noise[axis][quantity] = {"value": value, "low": low, "high": high, "unit": unit}
                if limit:
                    verdict = "pass" if high <= limit else "fail" if low > limit else "undecided"
                    checks.append({"sensor": sensor, "axis": axis, "quantity": quantity, "value": value,
                                   "low": low, "high": high, "bound": "max", "limit": limit,
                                   "unit": unit, "verdict": verdict})  # fmt: skip
        sensors[sensor] = {"noise": noise}
        if padding:
            sensors[sensor]["allan"] = {"x": {"adev": rng.normal(size=padding).tolist()}}
    name = "unit-" + f"{k:05d}"
    return {
        "schema": 1,
        "device": {"id": name, "name": f"Unit {k}", "model": models[k % len(models)], "serial": str(k)},
        "software": {"sensorbook": "0.1.0", "python": "3.11", "numpy": "2", "scipy": "1"},
        "created": "2026-01-02T03:04:05+00:00",
        "inputs": [], "sensors": sensors, "checks": checks, "warnings": [],
        "chapters": [{"sensor": s, "chapter": "noise", "title": "Noise identification", "status": "complete",
                      "reason": None, "page": f"{s}/noise.html", "notebook": f"{s}/noise.ipynb"}
                     for s in sensors],
        "problems": [], "guesses": [],
    }  # fmt: skip
