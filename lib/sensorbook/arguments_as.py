"""What arguments of the command line may be: types for argparse."""

from __future__ import annotations

import argparse
import re


def above_zero(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < 1e9:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return value


def seed(text: str) -> int:
    if not text.isdigit():
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 0")
    return int(text)


def columns(text: str) -> dict[str, str]:
    pairs = [part.partition("=") for part in text.split(",")]
    found = {key.strip(): name.strip() for key, _, name in pairs}
    unknown = set(found) - {"x", "y", "z", "temperature", "time"}
    given = list(found.values())
    bad = unknown or not {"x", "y", "z"} <= set(found) or not all(given)
    if bad or len(set(given)) < len(given):
        raise argparse.ArgumentTypeError(f"{text!r} is not x=…,y=…,z=… (temperature=…, time=…)")
    return found


def folder(text: str) -> str:
    if not text:
        raise argparse.ArgumentTypeError("'' names no folder")
    return text


def address(text: str) -> str:
    if not re.fullmatch(r"((tcp|tls|ws|wss|ucx)://)?[^:/\s]+:\d+", text):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no scheduler's address, as tcp://10.0.0.1:8786"
        )
    return text


def count(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 1")
    return int(text)
