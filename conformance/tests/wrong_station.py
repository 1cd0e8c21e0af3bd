"""Stations that do wrong: the reference, with a few lines in between."""

from __future__ import annotations

import sys

STATION = """
import json, os, sys, time
{first}
from automcm.adapters import adapter_lines as kit
from automcm.adapters.adapter_lines import Kit
station = Kit()

def answer(command):
    try:
        return station.answer(command)
    except (KeyError, TypeError, ValueError) as error:
        return {{"error": str(error)}}

def state():
    return station._station.state

def received(command, type_):
    return command["cmd"] == "receive" and command["message"].get("type") == type_

def foreign(command):
    "A Prescription of a session that the station is not bound to, while it is bound to one."
    return received(command, "Prescription") and state().bound and (
        tuple(command["message"]["session"]) != state().session)

right = answer
{code}
for line in sys.stdin.buffer:
    command = json.loads(line)
    if command["cmd"] == "stop":
        break
    out = answer(command)
    out = out if isinstance(out, bytes) else json.dumps(out).encode() + b"\\n"
    sys.stdout.buffer.write(out)
    sys.stdout.buffer.flush()
"""
"""The reference; ``code`` may replace ``answer``."""


def station(code: str = "", first: str = "") -> list[str]:
    return [sys.executable, "-c", STATION.format(first=first, code=code)]
