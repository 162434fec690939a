"""Random calibration files, and what host, model and firmware say to them."""

import contextlib
import ctypes
import random
import tomllib
from functools import cache
from pathlib import Path

from hardware import protocol
from hardware.boards.firmware_board import FirmwareBoard
from hardware.boards.wire_records import wire_record
from hardware.errors import HardwareError
from hardware.executor import Executor
from hardware.frames import crc16
from hardware.joint_map import JointMap
from hardware.joint_map_file import load_joint_map
from tests.helpers.firmware import FIRMWARE, folder, run

NOWHERE = 0x0F  # a channel that no board has
_SILENCE_MS = 300, 2000
_CHANNELS = [*(f"D{i}" for i in range(2, 8)), *(f"D{chain}/{place}" for chain in (8, 9) for place in range(1, 5))]
_SMART = {"raw_range": [24, 232], "neutral": 128, "raw_per_rad": 66.21}
_PULSE = {"raw_range": [500, 2500], "neutral": 1500, "raw_per_rad": 636.62}
_NUMBERS = [0, -1, 1, 0.4, 1.7, 1e-9, 1e9, 1e300, -1e9, 65536, 2**63, 10**300]
_ODD_CHANNELS = ["A3", "5", "", "D1", "D8", "D8/5", "D02", "D8/1", "D2", "d2", "arduino:D3", "maestro:1", "D٢"]


def random_file(seed: int) -> str:
    """Return a calibration file: a right one, or one with a few numbers at, near or far beyond what is right."""
    rng = random.Random(seed)
    joints = [_joint(rng, channel) for channel in rng.sample(_CHANNELS, rng.randint(1, len(_CHANNELS)))]
    for _ in range(rng.choice([0, 0, 1, 1, 1, 2, 3])):
        _spoil(rng, rng.choice(joints))
    rows = (f"\n[[joint]]\nname = 'joint {i}'\n" + _table(joint) for i, joint in enumerate(joints))
    return "format = 1\nrobot = 'random'\n" + "".join(rows)


def _joint(rng: random.Random, channel: str) -> dict:
    """Return a joint whose servo can do what it asks for."""
    servo, smart = (_SMART, True) if "/" in channel else (_PULSE, False)
    low, high = sorted(rng.uniform(-80, 80) for _ in range(2))
    high = max(high, low + 3)
    return {
        **servo,
        "sign": rng.choice([1, -1]),
        "limits_deg": [low, high],
        "max_rate_deg_s": rng.uniform(10, 400),
        "safe_deg": rng.uniform(low, high),
        "readback": smart,
        "channel": channel,
    }


def _spoil(rng: random.Random, joint: dict) -> None:
    """Change one number: a little around the edge of what is right, or to something absurd."""
    key = rng.choice(["raw_range", "neutral", "raw_per_rad", "sign", "limits_deg", "max_rate_deg_s", "safe_deg"] * 3 + [
        "channel", "readback"
    ])  # fmt: skip
    if key == "channel":
        joint[key] = rng.choice(_ODD_CHANNELS + _CHANNELS)
    elif key == "readback":
        joint[key] = not joint[key]
    elif key == "sign":
        joint[key] = rng.choice([-1, 1, 1.0, 0, 1.7, -1e9, 2])
    elif key == "max_rate_deg_s":
        edges = (1000, 1731, 2250, 0.14, 1.35, 2.7)  # of the step: a whole step, or half of one, which rounds up
        joint[key] = rng.choice([*_NUMBERS, *(edge * rng.uniform(0.99, 1.01) for edge in edges * 2)])
    elif key == "raw_range":
        smart = "/" in joint["channel"]
        ends = [22, 23, 24, 25] if smart else [398, 399, 400, 401]
        top = [230, 231, 232, 233, 255, 256] if smart else [2599, 2600, 2601, 4000, 65536]
        joint[key] = [rng.choice([*ends, -500, 0]), rng.choice([*top, 2500, 100])]
    elif key == "limits_deg":
        middle, width = rng.uniform(-100, 100), rng.choice([0, 0.01, 0.5, 1, 30, 170, 1e5, -10])
        joint[key] = [middle - width / 2, middle + width / 2]
    else:
        joint[key] = joint[key] + rng.uniform(-1, 1) * 100 if rng.random() < 0.5 else rng.choice(_NUMBERS)


def _table(joint: dict) -> str:
    text = {True: "true", False: "false"}
    rows = {k: text[v] if isinstance(v, bool) else f"'{v}'" if isinstance(v, str) else v for k, v in joint.items()}
    return "".join(f"{key} = {value}\n" for key, value in rows.items())


class _Arduino(FirmwareBoard):
    """The host's side without a board."""

    def __init__(self) -> None:
        pass


def host(file: Path) -> tuple[list[protocol.Record], str]:
    """Return the records that the host would send to an Arduino, or none and why it refuses the file."""
    try:
        joints: JointMap = load_joint_map(file)
        channels = _Arduino()._assign(joints)
        return [wire_record(*pair) for pair in zip(joints.joints, channels, strict=True)], ""
    except HardwareError as error:
        return [], str(error)


def unchecked_records(text: str) -> list[protocol.Record] | None:
    """Return the records of a file as another program might send them, unchecked; None if they do not fit the wire."""
    records = []
    for joint in tomllib.loads(text)["joint"]:
        with contextlib.suppress(OverflowError):
            at = lambda deg, j=joint: round(j["neutral"] + j["sign"] * j["raw_per_rad"] * deg * 0.017453292519943295)  # noqa: E731
            ends = sorted(map(at, joint["limits_deg"]))
            low, high = max(joint["raw_range"][0], ends[0]), min(joint["raw_range"][1], ends[1])
            step = round(joint["max_rate_deg_s"] * 0.017453292519943295 * joint["raw_per_rad"] * 0.32)
            channel = protocol.parse_channel(joint["channel"])
            channel = NOWHERE if channel is None else channel
            record = protocol.Record(channel, low, high, step, min(max(at(joint["safe_deg"]), low), high))
            if all(0 <= number <= 0xFFFF for number in record):
                records.append(record)
                continue
        return None
    return records


def model(records: list[protocol.Record]) -> tuple[int, int]:
    """Return the model's fault and the place of the joint it is about, after a configuration."""
    executor = Executor()
    packed = b"".join(record.pack() for record in records)
    fault = 0
    for payload in protocol.config_payloads(records):
        fault = fault or executor.config(payload[0], payload[1], payload[2:])
    fault = fault or executor.commit(1, crc16(packed), *_SILENCE_MS)
    return int(fault), executor.fault_joint if fault else 0


def firmware(records: list[protocol.Record]) -> tuple[int, int]:
    """Return the same of the firmware's motion.c, compiled for this machine."""
    lib = _library()
    lib.config_reset()
    fault = 0
    for payload in protocol.config_payloads(records):
        fault = fault or lib.motion_config(payload, len(payload))
    packed = b"".join(record.pack() for record in records)
    fault = fault or lib.motion_commit(protocol.commit_payload(1, crc16(packed), *_SILENCE_MS))
    return fault, lib.config_fault_joint() if fault else 0


@cache
def _library() -> ctypes.CDLL:
    """Build the firmware's checks for this machine."""
    out, shim = folder() / "config.so", folder() / "config.c"
    shim.write_text(
        f'#include <string.h>\n#include "{FIRMWARE}/motion.h"\n'
        "void config_reset(void) { memset(&motion, 0, sizeof motion); }\n"
        "unsigned config_fault_joint(void) { return motion.fault_joint; }\n"
    )
    run("gcc", "-O2", "-shared", "-fPIC", "-fshort-enums", shim, FIRMWARE / "motion.c", FIRMWARE / "frame.c", "-o", out)
    return ctypes.CDLL(str(out))
