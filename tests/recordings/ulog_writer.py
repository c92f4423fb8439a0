"""ULog files byte by byte, after the PX4 Guide's "ULog File Format": no library has a part in them."""

from __future__ import annotations

import struct

import numpy as np

MAGIC = b"ULog\x01\x12\x35"
SYNC = bytes.fromhex("2f731320250cbb12")
CODES = {"uint64_t": "Q", "uint32_t": "I", "int32_t": "i", "int16_t": "h", "uint8_t": "B",
         "float": "f", "double": "d"}  # fmt: skip

# Fields as PX4 v1.14 defines them (msg/SensorAccel.msg and so on), in the order of its own logs.
ACCEL = ("uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float x;float y;float z;"
         "float temperature;uint32_t error_count;uint8_t[3] clip_counter;uint8_t samples;")  # fmt: skip
MAG = ("uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float x;float y;float z;"
       "float temperature;uint32_t error_count;uint8_t[4] _padding0;")  # fmt: skip
COMBINED = ("uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;"
            "int32_t accelerometer_timestamp_relative;float[3] accelerometer_m_s2;"
            "uint32_t accelerometer_integral_dt;uint8_t accelerometer_clipping;"
            "uint8_t gyro_clipping;uint8_t accel_calibration_count;"
            "uint8_t gyro_calibration_count;")  # fmt: skip
IMU = ("uint64_t timestamp;uint64_t timestamp_sample;uint32_t accel_device_id;"
       "uint32_t gyro_device_id;float[3] delta_angle;float[3] delta_velocity;"
       "uint32_t delta_angle_dt;uint32_t delta_velocity_dt;uint8_t delta_angle_clipping;"
       "uint8_t delta_velocity_clipping;uint8_t accel_calibration_count;"
       "uint8_t gyro_calibration_count;")  # fmt: skip
FIFO = ("uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float dt;float scale;"
        "int16_t[32] x;int16_t[32] y;int16_t[32] z;uint8_t samples;")  # fmt: skip
ATTITUDE = ("uint64_t timestamp;uint64_t timestamp_sample;float[4] q;float[4] delta_q_reset;"
            "uint8_t quat_reset_counter;")  # fmt: skip


def message(kind: str, content: bytes) -> bytes:
    return struct.pack("<HB", len(content), ord(kind)) + content


def definition(name: str, fields: str) -> bytes:
    return message("F", f"{name}:{fields}".encode())


def subscription(name: str, number: int, instance: int = 0) -> bytes:
    return message("A", struct.pack("<BH", instance, number) + name.encode())


def datum(fields: str, number: int, values: dict) -> bytes:
    """A message of data; fields without a value are 0, and padding at the end is not written."""
    out = struct.pack("<H", number)
    for field in fields.rstrip(";").split(";"):
        kind, name = field.split(" ")
        kind, _, count = kind.rstrip("]").partition("[")
        if name.startswith("_padding"):
            continue
        given = np.atleast_1d(values.get(name, 0))
        items = given if len(given) == int(count or 1) else np.zeros(int(count or 1))
        for item in items:
            out += struct.pack(
                "<" + CODES[kind], item if kind in ("float", "double") else int(item)
            )
    return message("D", out)


def flags(appended: int = 0, incompatible: int = 0) -> bytes:
    first = incompatible | (1 if appended else 0)
    return message("B", bytes(8) + bytes([first]) + bytes(7) + struct.pack("<3Q", appended, 0, 0))


def log(*topics: tuple, extra: list = (), begin: bytes | None = None) -> bytes:
    """A log of topics (name, instance, fields, columns by name), messages in the order of their stamps.

    `extra` are pairs of a stamp (µs) and a message, such as a dropout.
    """
    parts = [MAGIC + b"\x01" + struct.pack("<Q", 1000), flags() if begin is None else begin]
    parts.append(message("I", b"\x0achar[4] sys" + b"TEST"))
    parts += [definition(name, fields) for name, fields in {t[0]: t[2] for t in topics}.items()]
    parts += [message("P", b"\x11int32_t IMU_TEST1" + struct.pack("<i", 7))]
    parts += [subscription(t[0], number, t[1]) for number, t in enumerate(topics)]
    rows = list(extra)
    for number, (_, _, fields, columns) in enumerate(topics):
        for k in range(len(columns["timestamp"])):
            row = {name: values[k] for name, values in columns.items()}
            rows.append((int(row["timestamp"]), datum(fields, number, row)))
    rows.sort(key=lambda row: row[0])
    parts += [content for _, content in rows]
    parts.insert(len(parts) // 2, message("S", SYNC))
    return b"".join(parts)
