"""A Meccanoid's own servos over Bluetooth LE, and several boards that play one trajectory together."""

import sys
import types
from dataclasses import replace

import numpy as np
import pytest

import hardware
from hardware import Fault, PlayResult, State
from hardware.boards import CompositeBoard, SimulatedBoard, bluetooth
from hardware.boards.maestro import MaestroBoard
from hardware.boards.meccanoid import MeccanoidBoard, content, frame
from hardware.clock import VirtualClock
from jaxik import Trajectory
from tests.helpers.meccanoid import MeccanoidFake
from tests.helpers.playing import plan_in_raw
from tests.helpers.servo_bus import Maestro

SLOTS = {"right_shoulder_swing": 2, "right_shoulder_lift": 1, "right_elbow_flexion": 0}
RIGHT = [joint for joint in hardware.load_joint_map("meccanoid.toml").joints if joint.name.startswith("right_")]
OWN = tuple(replace(joint, channel=str(SLOTS[joint.name])) for joint in RIGHT if joint.name in SLOTS)
MIXED = hardware.JointMap(
    "paper's wiring",
    tuple(
        replace(
            joint, channel=f"meccanoid:{SLOTS[joint.name]}" if joint.name in SLOTS else f"simulated:{joint.channel}"
        )
        for joint in RIGHT
    ),
)
TIMES = np.linspace(0, 4, 101)


def motion(joints):
    middle = (joints.column("lower") + joints.column("upper")) / 2
    return Trajectory(TIMES, middle + 0.4 * np.sin(1.5 * TIMES)[:, None], joints.names)


def meccanoid(**options):
    clock = VirtualClock()
    fake = MeccanoidFake(clock, **options)
    return MeccanoidBoard(exchange=fake, clock=clock), fake


@pytest.mark.parametrize(
    "printed", ["1901000000000000000000000000000000000000", "0d0000000000ffff00000000000000000000"]
)
def test_frames_have_a_sum_and_twenty_bytes(printed):
    body = bytes.fromhex(printed)
    built = frame(body[0], body[1:18])
    assert len(built) == 20
    assert int.from_bytes(built[-2:], "big") == sum(built[:-2])
    assert content(built, body[0]) == built[1:18]
    assert content(built, body[0] ^ 1) is None
    assert content(built[:-1] + b"\x77", body[0]) is None


@pytest.mark.parametrize("trouble", [{}, {"lose": 0.05}, {"garble": 0.05}])
def test_the_robots_own_servos_play(trouble):
    board, fake = meccanoid(**trouble)
    joints = hardware.JointMap("own", OWN)
    rest = [fake.pose[slot] for slot in range(3, 8)]
    with board:
        tolerances = hardware.Tolerances(path=0.6)
        report = hardware.play(motion(joints), board, joints, park=False, tolerances=tolerances)
        assert report.result is PlayResult.SUCCESS, report.message
    assert (board.retries > 0) == bool(trouble)
    assert fake.pose[3:] == rest, "servos that are no joint's stay"
    assert fake.mode == 4, "limp again"
    assert fake.closed
    end = joints.to_raw(motion(joints).q[-1])
    assert [fake.pose[SLOTS[name]] for name in joints.names] == end.tolist()
    assert 0x01 in fake.operations, "its status was asked for"


def test_a_robot_that_refuses_or_does_not_answer():
    clock = VirtualClock()
    with pytest.raises(hardware.BoardError, match="press its yellow button"):
        MeccanoidBoard(exchange=MeccanoidFake(clock, refuse=True), clock=clock)
    with pytest.raises(hardware.LinkError, match="is it on, near"):
        MeccanoidBoard(exchange=MeccanoidFake(clock, lose=1.0), clock=clock)


def together(latency_s=0.0, **options):
    own, fake = meccanoid(**options)
    wire = SimulatedBoard(clock=own.clock)
    return CompositeBoard({"meccanoid": own, "simulated": wire}, {"meccanoid": latency_s}), fake, wire


def test_two_boards_play_one_trajectory_together():
    both, fake, wire = together(latency_s=0.05)
    trajectory, starts, first = motion(MIXED), [], list(fake.pose)
    start_at = both.start_at
    both.start_at = lambda host_s: (starts.append(host_s), start_at(host_s))[1]
    with both:
        tolerances = hardware.Tolerances(path=0.6)
        report = hardware.play(trajectory, both, MIXED, park=False, tolerances=tolerances)
    assert report.result is PlayResult.SUCCESS, report.message
    assert report.log.commanded.shape[1] == len(RIGHT)
    stood = MIXED.to_raw(MIXED.column("safe"))
    for name, slot in SLOTS.items():
        stood[MIXED.names.index(name)] = first[slot]
    present = MIXED.to_rad(stood)
    times, raw = plan_in_raw(trajectory, MIXED, present)
    for name, slot in SLOTS.items():
        wanted = raw[:, MIXED.names.index(name)]
        at, sent = np.array([(at, pose[slot]) for at, pose in fake.history if 0.2 < at - starts[0] < times[-1]]).T
        near = [np.interp(at - starts[0] + 0.05 - late, times, wanted) for late in (0.0, 0.03, 0.06)]
        assert np.abs(np.array(near) - sent).min(0).max() < 1.5, "50 ms ahead of the clock, within the link's delay"
    wrist = MIXED.names.index("right_wrist_roll")
    at = np.array([1e-6 * frame.time_us for frame in wire.log]) + 0.06  # connected after two of the robot's answers
    now = (at > starts[0]) & (at < starts[0] + times[-1])
    commanded = np.array([frame.commanded[1] for frame in wire.log])
    off = np.abs(commanded - np.interp(at - starts[0], times, raw[:, wrist]))[now]
    assert now.sum() > 200
    assert off.max() < 640 * 0.6 * 0.022, "within a servo frame"


def test_a_fault_of_one_stops_all():
    both, fake, wire = together()
    tolerances = hardware.Tolerances(path=0.6)
    with both:
        run = wire.model.run

        def run_and_unplug(until_us):
            if wire.model.now_us < 4_000_000 <= until_us:
                wire.model.modules[0].unplug(2)
            run(until_us)

        wire.model.run = run_and_unplug
        report = hardware.play(motion(MIXED), both, MIXED, tolerances=tolerances)
        assert report.result is PlayResult.LINK_LOST
        assert report.message.startswith("the board stopped: right_upper_arm_roll: a smart servo does not answer")
        assert both._parts[0].board.status().state is State.DETACHED
    assert fake.history[-1][0] < 4.6, "the other board got no more goals"


def test_a_robot_that_goes_away_stops_the_wire():
    both, fake, wire = together()
    with both:
        both.configure(MIXED)
        both.enable()
        fake.gone = True
        with pytest.raises(hardware.LinkError, match="the servos do not answer"):
            [both.status() for _ in range(20)]
        assert wire.status().fault is Fault.NONE
        fake.gone = False


def test_every_board_has_the_interface():
    both, _, wire = together()
    maestro = MaestroBoard(transport=Maestro(), clock=VirtualClock())
    for board in (both, wire, both._all["meccanoid"].board, maestro):
        assert isinstance(board, hardware.Board)


def test_channels_say_which_board():
    both, _, _ = together()
    with both, pytest.raises(hardware.BoardError, match="begins with its board, meccanoid: or simulated:; got '2'"):
        both.configure(hardware.JointMap("own", OWN))
    with pytest.raises(hardware.BoardError, match="one clock"):
        CompositeBoard({"a": SimulatedBoard(), "b": SimulatedBoard()})


def test_bluetooth_through_bleak(monkeypatch):
    """Play through a stand-in for bleak that connects, notifies, and passes the fake robot's answers on."""
    fake, clients = MeccanoidFake(VirtualClock()), []

    class BleakClient:
        def __init__(self, address):
            self.address, self.connected = address, False
            clients.append(self)

        async def connect(self):
            if self.address == "nowhere":
                raise RuntimeError("device not found")
            self.connected = True

        async def start_notify(self, characteristic, callback):
            assert characteristic.startswith("0000fff1")
            self.notify = callback

        async def write_gatt_char(self, characteristic, data, response):
            assert characteristic.startswith("0000fff2")
            self.notify(0, bytearray(b"\x55" * 20))  # answer to another request
            self.notify(0, bytearray(fake.ask(bytes(data), 0.1)))

        async def disconnect(self):
            self.connected = False

    monkeypatch.setitem(sys.modules, "bleak", types.SimpleNamespace(BleakClient=BleakClient))
    with hardware.connect("meccanoid:AA:BB:CC:DD:EE:FF") as board:
        assert clients[0].address == "AA:BB:CC:DD:EE:FF"
        board.configure(hardware.JointMap("own", OWN))
        assert board.status().measured.tolist() == [28, 214, 134]
    assert not clients[0].connected
    with pytest.raises(hardware.LinkError, match="Bluetooth: device not found"):
        bluetooth.BluetoothExchange("nowhere")
    monkeypatch.setitem(sys.modules, "bleak", None)
    with pytest.raises(hardware.BoardError, match="pip install bleak"):
        bluetooth.BluetoothExchange("anywhere")
