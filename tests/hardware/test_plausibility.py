"""Calibrations on host, model and firmware: accepted and refused alike, by one table of limits."""

import re
from dataclasses import replace

import numpy as np
import pytest

import hardware
from hardware import protocol, servo_limits
from hardware.boards.dynamixel import DYNAMIXEL
from hardware.boards.feetech import FEETECH
from hardware.boards.meccanoid import SERVOS
from hardware.boards.sdk_bus import SdkBoard
from hardware.channels import servo_at
from hardware.default_calibration import default_joint_map
from hardware.frames import Decoder, Frame, crc16, encode
from hardware.protocol import Message, Record
from jaxik import Trajectory
from tests.helpers import calibration_files as files
from tests.helpers.firmware import FIRMWARE, bench, require

# Numbers of a file that do not travel: the host alone can refuse them.
NOT_SENT = "sign must|raw_range|readback must|raw_per_rad|limits_deg (must|reach)|safe_deg|finite number|for any joint"


@pytest.fixture
def compiled():
    """Skip the test, or fail it if the firmware is required, where its C cannot be compiled."""
    require()


def test_the_firmwares_limits_are_those_of_the_host():
    header = (FIRMWARE / "limits.h").read_text()
    numbers = {name: int(value) for name, value in re.findall(r"\b([A-Z_]+) = (\d+)", header)}
    pulse, smart = servo_limits.PULSE_SERVO, servo_limits.SMART_SERVO
    assert numbers == {
        "PULSE_LOW": pulse.raw_low,
        "PULSE_HIGH": pulse.raw_high,
        "PULSE_MAX_STEP": pulse.max_step,
        "SMART_LOW": smart.raw_low,
        "SMART_HIGH": smart.raw_high,
        "SMART_MAX_STEP": smart.max_step,
    }


def judge(seed, folder):
    """Compare the three on one random file; return True if the host accepts it, and True if the firmware does."""
    text = files.random_file(seed)
    file = folder / "random.toml"
    file.write_text(text)
    records, refusal = files.host(file)
    unchecked = files.unchecked_records(text)
    if records:
        assert unchecked == records, f"seed {seed}"
        assert files.model(records) == files.firmware(records) == (0, 0), f"seed {seed}"
        return True, True
    if unchecked is None:
        return False, False
    verdict = files.model(unchecked)
    assert verdict == files.firmware(unchecked), f"seed {seed}: {refusal}"
    if not verdict[0]:
        assert re.search(NOT_SENT, refusal), f"seed {seed}: only the host refuses: {refusal}"
    return False, not verdict[0]


@pytest.mark.usefixtures("compiled")
def test_host_model_and_firmware_accept_and_refuse_the_same_files(tmp_path):
    both = [judge(seed, tmp_path) for seed in range(600)]
    accepted = sum(host for host, _ in both)
    assert 150 < accepted < 450
    assert sum(not firmware for _, firmware in both) > 50


@pytest.mark.usefixtures("compiled")
def test_host_model_and_firmware_agree_at_every_edge():
    """Each number of a record one below, at and one above each limit."""
    edges = {protocol.parse_channel("D2"): servo_limits.PULSE_SERVO, protocol.SMART: servo_limits.SMART_SERVO}
    accepted = 0
    for channel, servo in edges.items():
        sane = Record(channel, servo.raw_low, servo.raw_high, servo.max_step, servo.raw_low)
        near = [bound + d for bound in (0, servo.raw_low, servo.raw_high, servo.max_step) for d in (-1, 0, 1)]
        for field in ("low", "high", "step", "safe"):
            for value in (x for x in near if 0 <= x <= 0xFFFF):
                record = sane._replace(**{field: value})
                assert files.model([record]) == files.firmware([record]), record
                assert (files.model([record])[0] == 0) == record.plausible
                accepted += record.plausible
    assert accepted > 20
    for channel in range(256):
        record = Record(channel, 100, 200, 10, 150) if channel >= protocol.SMART else Record(channel, 500, 600, 10, 550)
        if channel < protocol.IDEAL:
            assert files.model([record]) == files.firmware([record]), channel


def test_the_binary_itself_says_the_same(tmp_path):
    """The firmware of the board in the simulator of its processor, by messages on its serial port."""
    with bench() as chip:
        decoder, sequence, verdicts = Decoder(), 0, []

        def say(kind, payload=b""):
            nonlocal sequence
            data = encode(Frame(sequence, kind, payload))
            sequence = (sequence + 1) % 256
            chip.receive(data)
            chip.run(chip.now_us + 100 * len(data) + 4000)
            (answer,) = decoder.feed(chip.take())
            return answer.payload[0] if answer.type == Message.ACK else None

        say(Message.HELLO)
        for seed in range(120):
            records = files.unchecked_records(files.random_file(seed))
            if records is None:
                continue
            fault = 0
            for payload in protocol.config_payloads(records):
                fault = fault or say(Message.CONFIG, payload)
            packed = b"".join(record.pack() for record in records)
            fault = fault or say(Message.COMMIT, protocol.commit_payload(1, crc16(packed), 300, 2000))
            verdicts.append(fault)
            assert fault == files.model(records)[0], f"seed {seed}"
    assert 20 < verdicts.count(0) < len(verdicts) - 10


MEANT = hardware.load_joint_map("meccanoid.toml").select(["right_elbow_flexion", "right_wrist_roll"])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"channel": "A3"}, "right_wrist_roll: channel 'A3' is none of any board; an Arduino has"),
        ({"channel": "5"}, "no board has all channels of the calibration: "),
        ({"channel": ""}, "no board has all channels of the calibration: "),
        ({"channel": "D8/4"}, "right_elbow_flexion and right_wrist_roll have one channel, 'D8/4'"),
        ({"max_rate": 1e9}, "right_wrist_roll: max_rate_deg_s must lie between 0.28 and 2250 for a hobby servo"),
        ({"raw_low": -500}, r"right_wrist_roll: raw_range \[-500, 2500\] must lie inside \[400, 2600\]"),
        ({"raw_per_rad": 1e-6}, "raw_per_rad = 1e-06 would make raw_range 1.15e"),
        ({"readback": True}, "readback must be false: a hobby servo does not report its position"),
        ({"lower": 0.0, "upper": 1e-6, "safe": 0.0}, "are less than a raw step apart"),
        ({"sign": 2}, "sign must be 1 or -1; got 2"),
        ({"lower": -1e6}, r"limits_deg must lie within ±7200; got \[-5.7"),
    ],
)
def test_a_dry_run_refuses_what_the_board_would(change, said):
    joints = hardware.JointMap("mine", (MEANT.joints[0], replace(MEANT.joints[1], **change)))
    with hardware.connect("simulated") as board, pytest.raises(hardware.HardwareError, match=said):
        board.configure(joints)
    with hardware.connect("simulated:arduino") as board, pytest.raises(hardware.HardwareError):
        board.configure(joints)


ON_A_BUS = replace(
    hardware.ideal_joint_map(["a"]).joints[0], raw_low=0, raw_high=30_000, neutral=15_000.0, raw_per_rad=2000.0
)


@pytest.mark.parametrize("channels", [("1", "2"), ("", "")])
def test_a_dry_run_as_an_arduino_needs_its_channels(channels):
    pairs = zip("ab", channels, strict=True)
    joints = hardware.JointMap("x", tuple(replace(ON_A_BUS, name=name, channel=channel) for name, channel in pairs))
    with hardware.connect("simulated") as board:
        assert board.configure(joints) == joints.crc, "a servo bus, or no board in particular"
    said = r"a: channel '1?' is none of a board of kind 'arduino'"
    with hardware.connect("simulated:arduino") as board, pytest.raises(hardware.CalibrationError, match=said):
        board.configure(joints)


def test_a_dry_run_takes_the_signed_positions_of_bus_servos():
    """Raw values below zero, as Feetech and Dynamixel servos have, move as others do."""
    low = replace(hardware.ideal_joint_map(["a"]).joints[0], raw_low=-9000, raw_high=9000, neutral=-1000.0, channel="1")
    joints = hardware.JointMap("x", (replace(low, raw_per_rad=652.0),))
    wave = Trajectory(np.linspace(0.0, 2.0, 101), np.sin(np.linspace(0.0, 3.0, 101))[:, None], ("a",))
    with hardware.connect("simulated:feetech") as board:
        report = hardware.play(wave, board, joints, park=False)
        assert report.ok, report.message
        assert board.status().commanded[0] == joints.to_raw(wave.q[-1:])[0, 0]
        played = report.log.measured[:, 0]
        assert np.nanmax(played) == pytest.approx(1.0, abs=0.03)
        board.configure(joints)
        board.enable()
        board.move([-1500])
        board.clock.sleep(2.0)
        assert board.status().commanded[0] == -1500


def test_channels_are_those_of_the_boards():
    for kind, servo_series, servo in (
        ("dynamixel", DYNAMIXEL, servo_limits.BUS_SERVO),
        ("feetech", FEETECH, servo_limits.FEETECH_SERVO),
    ):
        last = servo_series.ids[-1]
        assert servo_at(str(last), kind) == servo
        assert servo_at(str(last + 1), kind) is None
        low, high = servo_series.whole_range
        assert (servo.raw_low, servo.raw_high) == (max(low, -SdkBoard.zero), min(high, SdkBoard.zero - 1))
    assert servo_at(str(SERVOS - 1), "meccanoid") == servo_limits.SMART_SERVO
    assert servo_at(str(SERVOS), "meccanoid") is None


@pytest.mark.parametrize("kind", ["arduino", "dynamixel", "feetech", "maestro", "meccanoid"])
def test_calibrations_by_data_sheet_fit_their_boards(kind):
    joints = default_joint_map(kind, ["a", "b", "c"])
    joints.check(kind)
    assert joints.to_raw(np.zeros(3)).tolist() == [round(joint.neutral) for joint in joints.joints]
    with pytest.raises(hardware.CalibrationError, match="no calibration by data sheet for 'text'; there is one for"):
        default_joint_map("text", ["a"])


@pytest.mark.parametrize(
    ("kind", "channel", "fits"),
    [
        ("dynamixel", "252", True),
        ("dynamixel", "253", False),
        ("feetech", "253", True),
        ("feetech", "254", False),
        ("feetech", "05", False),
        ("maestro", "23", False),  # there are hobby servos, and they take 400 to 2600
        ("meccanoid", "8", False),
        ("arduino", "D2", False),
    ],
)
def test_every_board_has_channels_of_its_own(kind, channel, fits):
    joint = replace(ON_A_BUS, channel=channel)
    assert (joint.problems(kind) == []) == fits
    assert (replace(joint, channel=f"{kind}:{channel}").problems() == []) == fits


def test_a_speed_too_high_for_a_motion_that_stands_still_is_named():
    still = Trajectory(np.linspace(0.0, 2.0, 101), np.zeros((101, 1)), ("a",))
    with hardware.connect("simulated") as board:
        report = hardware.play(still, board, speed=1e9)
        assert report.result is hardware.PlayResult.LIMIT
        said = "the motion would last 2e-09 s, less than a servo frame of 0.02 s; play at speed 100 or below"
        assert report.message == said
        assert hardware.play(still, board, speed=100.0).ok


def test_a_board_that_does_not_exist_is_named_with_the_one_that_is_near():
    with pytest.raises(hardware.BoardError, match=r"did you mean arduino:/dev/ttyUSB0\? there are arduino, dynamixel"):
        hardware.connect("arduno:/dev/ttyUSB0")
    with pytest.raises(hardware.BoardError, match="no board of kind 'xyz'; there are arduino"):
        hardware.connect("xyz:1")
    with pytest.raises(hardware.BoardError, match="or as another board: simulated:arduino, "):
        hardware.connect("simulated:/dev/ttyUSB0")
