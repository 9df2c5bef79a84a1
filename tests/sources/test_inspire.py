"""An Inspire hand beside a robot: its values against another author's client, and the places of its pads."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

import tci
from helpers import HELPERS, ROOT
from helpers.dds_domains import DOMAINS
from helpers.peers import peer_python
from helpers.touch_devices import INSPIRE, InspireHand, free_port
from tci.capabilities import Capability, Need
from tci.cli.main import app
from tci.drivers.registry import source_at
from tci.drivers.source_fingers import joints_of
from tci.drivers.source_reader import SourceReader
from tci.errors import DriverError
from tci.messages import Order, Perception
from tci.reasons import Code
from tci.robot.description import Address, Binding
from tci.robot.tactile_devices import device, in_rows
from tci.runtime.loop import Tick

pytestmark = [pytest.mark.timeout(120), pytest.mark.xdist_group("sources")]
PEER = """
import json, sys
from inspire_rh56dftp import InspireHand
from inspire_rh56dftp.registers import TACTILE_READ_BATCHES, TACTILE_REGIONS
hand = InspireHand(ip="127.0.0.1", port=int(sys.argv[1]))
singly = {name: hand.read_holding(address, count) for name, address, count, _ in TACTILE_REGIONS}
batched = {}
for address, parts in TACTILE_READ_BATCHES:
    values = hand.read_holding(address, sum(count for _, count in parts))
    for name, count in parts:
        batched[name], values = values[:count], values[count:]
print(json.dumps([singly, batched]))
hand.close()
"""


@pytest.fixture
def hand() -> Iterator[InspireHand]:
    made = InspireHand()
    made.plug()
    time.sleep(0.1)
    yield made
    made.unplug()


def test_another_authors_client_reads_the_same_flat_values(hand: InspireHand) -> None:
    hand.number()
    command = [peer_python("inspire"), "-c", PEER, str(hand.port)]
    singly, batched = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    names = {"pinky": "little", "nail": "top"}
    theirs = {"_".join(names.get(word, word) for word in name.split("_")): v for name, v in singly.items()}
    assert singly == batched
    with tci.connect("g1-inspire", f"sim + {hand.via},side=left") as driver:
        time.sleep(0.3)
        ours = {frame.patch: frame.values.tolist() for frame in driver.read().skin}
    assert {pad: ours[f"left_{pad}"] for pad in INSPIRE} == theirs
    assert sum(map(len, theirs.values())) == 1062


def test_a_server_of_another_author_is_read_whole() -> None:
    port = free_port()
    command = [peer_python("inspire"), str(HELPERS / "inspire_modbus.py"), str(port)]
    server = subprocess.Popen([*command, json.dumps([*INSPIRE.values()])])
    try:
        via, end = f"inspire:127.0.0.1:{port}", time.monotonic() + 20.0
        while True:
            try:
                reader = SourceReader(via, source_at(via), {pad: size for pad, (_, size) in INSPIRE.items()})
                break
            except DriverError:
                assert time.monotonic() < end, "it does not start"
                time.sleep(0.1)
        reader.wait(10.0)
        flat = [value for pad in INSPIRE for value in reader.pads[pad].values.tolist()]
        reader.close()
        assert flat == [7 * k % 4096 for k in range(1062)]
    finally:
        server.kill()
        server.wait()


def pressed(driver: tci.Driver, patch: str) -> np.ndarray:
    """Where a new perceiver sees the only contact of a patch: in the link's frame, then in the torso's."""
    perceiver, end = tci.Perceiver(tci.GenericBody(driver.robot)), time.monotonic() + 5.0
    while time.monotonic() < end:
        now = driver.clock.now()
        found = [one for one in perceiver.step(driver.read(), now).contacts if one.patch == patch]
        if found:
            return np.array([found[0].p_L, found[0].p_T])
        driver.clock.sleep_until(now + 0.02)
    raise AssertionError(f"no contact on {patch}")


def test_pressed_corners_show_where_the_manual_puts_them(hand: InspireHand) -> None:
    """Fingers: value 2 is row 1, column 2. Palm: value 1 is row 8, column 1, and value 9 row 8, column 2.
    Row 1 at the far end is assumed, since no maker says it."""
    pitch = {"palm": (30.4e-3 / 8, 50.2e-3 / 14), "index_top": (15.4e-3 / 12, 11.0e-3 / 8)}
    corners = {  # row and column of a value, all from 0
        "palm": {0: (7, 0), 7: (0, 0), 104: (7, 13), 111: (0, 13), 8: (7, 1)},
        "index_top": {0: (0, 0), 7: (0, 7), 88: (11, 0), 95: (11, 7), 8: (1, 0)},
    }
    seen: dict[str, dict[tuple[int, int], np.ndarray]] = {pad: {} for pad in corners}
    with tci.connect("g1-inspire", f"sim + {hand.via},side=right") as driver:
        for pad, places in corners.items():
            for value, place in places.items():
                hand.values[pad][value] = 2000
                seen[pad][place] = pressed(driver, f"right_{pad}")
                hand.values[pad][value] = 0
                time.sleep(0.1)
    for pad, points in seen.items():
        rows, columns = pitch[pad]
        for (r, c), (here, _) in points.items():
            for (s, d), (there, _) in points.items():
                apart = np.hypot((r - s) * rows, (c - d) * columns)
                assert np.linalg.norm(here - there) == pytest.approx(apart, abs=1e-3)
    finger, palm = seen["index_top"], seen["palm"]
    assert np.linalg.norm(finger[0, 0][1] - palm[7, 0][1]) > np.linalg.norm(finger[11, 0][1] - palm[7, 0][1])
    assert np.linalg.norm(palm[0, 0][1] - finger[0, 0][1]) < np.linalg.norm(palm[7, 0][1] - finger[0, 0][1])


def test_the_sender_for_a_robots_computer_sends_what_the_hand_says(hand: InspireHand, tmp_path: Path) -> None:
    """The program on the page of operating systems."""
    hand.number()
    (text,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "platforms.md").read_text(), re.DOTALL)
    assert text.count("\n") <= 30
    port = free_port()
    program = tmp_path / "sender.py"
    program.write_text(text.replace("9000", str(port)).replace("(hand, 6000)", f"(hand, {hand.port})"))
    sender = subprocess.Popen([sys.executable, str(program), "127.0.0.1", "127.0.0.1"])
    try:
        with tci.connect("g1-inspire", f"sim + array:udp://127.0.0.1:{port}") as driver:
            ours, end = dict[str, list[float]](), time.monotonic() + 10.0
            while not ours and time.monotonic() < end:
                time.sleep(0.05)
                frames = [one for one in driver.read().skin if not np.isnan(one.values).any()]
                ours = {one.patch: one.values.tolist() for one in frames}
        assert ours == {f"right_{pad}": hand.values[pad] for pad in ("palm", "index_top")}
    finally:
        sender.kill()
        sender.wait()


RANGES = {  # [rad], of Unitree's URDF; in the order of the registers
    "little_1": 1.4381, "ring_1": 1.4381, "middle_1": 1.4381, "index_1": 1.4381, "thumb_2": 0.5864,
    "thumb_1": 1.1641,
}  # fmt: skip
FOLLOW = {"index_2": ("index_1", 1.0843), "middle_2": ("middle_1", 1.0843), "ring_2": ("ring_1", 1.0843),
          "little_2": ("little_1", 1.0843), "thumb_3": ("thumb_2", 0.8024),
          "thumb_4": ("thumb_2", 0.76123688)}  # fmt: skip
"""Joints of the URDF that follow others."""


class Judge:
    """MuJoCo's own kinematics of the model, with the fingers as a hand says."""

    def __init__(self, driver: tci.Driver) -> None:
        self.model = tci.World("g1-inspire").model
        self.data = mujoco.MjData(self.model)
        for servo, angle in zip(driver.robot.servos, driver.read().joints.position, strict=True):
            self.data.joint(servo.joint).qpos = angle

    def place(self, link: str, p_L: np.ndarray, counts: list[float]) -> np.ndarray:
        """In the torso's frame [m]."""
        pairs = zip(RANGES.items(), counts, strict=True)
        bent = {name: most * (1000 - count) / 1000 for (name, most), count in pairs}
        for name, angle in (bent | {one: by * bent[of] for one, (of, by) in FOLLOW.items()}).items():
            self.data.joint(f"left_{name}_joint").qpos = angle
        mujoco.mj_kinematics(self.model, self.data)
        torso, body = self.data.body("torso_link"), self.data.body(link)
        at = body.xpos + body.xmat.reshape(3, 3) @ p_L
        return torso.xmat.reshape(3, 3).T @ (at - torso.xpos)


def test_a_hands_own_angles_place_its_touches_and_its_fingers_are_not_moved(hand: InspireHand) -> None:
    counts = [700, 100, 350, 200, 300, 450]
    hand.angles = lambda: counts
    with tci.connect("g1-inspire", f"sim + {hand.via},side=left") as driver:
        judge = Judge(driver)
        for pad in ("index_top", "little_tip", "thumb_pad", "thumb_tip", "middle_pad"):
            hand.values[pad][4] = 3000
            p_L, p_T = pressed(driver, f"left_{pad}")
            link = driver.robot.patch(f"left_{pad}").link
            assert np.linalg.norm(p_T - judge.place(link, p_L, counts)) < 1e-5
            assert np.linalg.norm(p_T - judge.place(link, p_L, [1000] * 6)) > 0.01, "not as if it were open"
            hand.values[pad][4] = 0
        told = [one.what for one in driver.diagnose() if one.subject.startswith("inspire")]
        assert any("measures 6 finger joints, of which 6 place touches" in one for one in told)
        assert not any("place assumed" in one for one in told)
        order = driver.native("left_arm").command({"left_index_1_joint": 0.5})
        sent = driver.write(driver.gate.step([order], driver.read().joints, driver.clock.now()))
        (refusal,) = sent.refusals
        assert re.search("left_index_1_joint can't be moved: inspire:.* is only read", refusal.text)


def test_a_finger_that_moves_is_placed_where_it_was_when_it_felt(hand: InspireHand) -> None:
    """One sweep of the hand takes 0.2 s or more, and the finger moves by 0.1 rad in it."""
    begins, hand.breath = [np.inf], 0.01

    def index(now: float) -> float:
        return float(np.clip(1000.0 - 350.0 * (now - begins[-1]), 100.0, 1000.0))

    hand.angles = lambda: [1000, 1000, 1000, round(index(time.monotonic())), 1000, 1000]
    hand.values["index_top"][4] = 3000
    off: list[float] = []
    with tci.connect("g1-inspire", f"sim + {hand.via},side=left", rate=100.0) as driver:
        judge, perceiver = Judge(driver), tci.Perceiver(tci.GenericBody(driver.robot))
        frames = [driver.readers[0].pads[f"index_{pad}"] for pad in ("tip", "top", "pad")]
        begins.append(time.monotonic() + 0.2)
        for now in driver.ticks(duration=2.4):
            reading = driver.read()
            when = max(frame.stamp for frame in frames)
            found = [one for one in perceiver.step(reading, now).contacts if one.patch == "left_index_top"]
            if found and index(when) > 200.0 and index(when - 0.6) < 1000.0:
                counts = [1000.0] * 3 + [index(when)] + [1000.0] * 2
                there = judge.place("left_index_force_sensor_2", found[0].p_L, counts)
                off.append(float(np.linalg.norm(found[0].p_T - there)))
    assert len(off) > 20
    assert np.median(off) < 2e-3
    assert np.quantile(off, 0.9) < 4e-3, "with the angles before the frame it would be 10 mm"


def test_pads_on_fingers_that_nobody_measures_are_told() -> None:
    with tci.connect("g1-inspire", "sim + array:feed,patch=left_index_top/left_palm") as driver:
        (told,) = (one.what for one in driver.diagnose() if "place assumed" in one.what)
    assert "of 1 pads on fingers that nobody measures" in told
    assert "left_palm" not in told


def test_a_servo_is_a_hands_joint_by_the_makers_name_or_by_its_address() -> None:
    robot = tci.load_robot("g1-inspire")
    names = {servo.index: servo.name for servo in robot.servos}
    own = Binding(
        middleware="brainco", rate=50, stale_after=0.1,
        addresses=(Address(of="right_ring_1_joint", to="ring"),),
    )  # fmt: skip
    bound = robot.model_copy(update={"bindings": (*robot.bindings, own)})
    found = {
        names[servo]: one for servo, one in joints_of(bound, "brainco", "right", "brainco-revo2").items()
    }
    assert [*found] == ["right_ring_1_joint"]
    assert [found["right_ring_1_joint"].angle(share) for share in (0.0, 1.0)] == [0.0, 1.41]
    by_name = joints_of(robot, "inspire", "left", "inspire-rh56dftp")
    assert sorted(names[servo] for servo in by_name) == sorted(f"left_{name}_joint" for name in RANGES)
    assert not joints_of(robot, "inspire", "", "inspire-rh56dftp"), "which hand is not said"


class Idle(Capability[None]):
    """Needs nothing."""

    def init(self, body: tci.GenericBody) -> None:
        return None

    def step(
        self, memory: None, perception: Perception, body: tci.GenericBody
    ) -> tuple[tuple[Order, ...], None]:
        return (), None


class Feels(Idle):
    """Needs the skin of the left fingers."""

    @property
    def needs(self) -> tuple[Need, ...]:
        return (Need("skin on the left fingers", ("left_fingers",)),)


def test_a_silent_hand_holds_only_who_needs_it(hand: InspireHand, caplog: pytest.LogCaptureFixture) -> None:
    hand.values["palm"] = [2000] * 112
    with tci.connect("g1-inspire", f"sim + {hand.via},side=left", arm=True) as driver:
        pressed(driver, "left_palm")
        felt: list[int] = []

        def watch(tick: Tick) -> None:
            felt.append(len(tick.perception.contacts))
            hand.pull()

        result = tci.run(driver, Idle(), duration=1.2, observe=watch)
        hand.unplug()
        assert not result.holds
        assert felt[0]
        assert not felt[-1], "a pad that is gone still feels"
        told = [record.message for record in caplog.records if "sends nothing" in record.message]
        assert len(told) == 1
        assert "left_fingers is noticed by joints only, as on a part without skin" in told[0]
        held = tci.run(driver, Feels(), duration=0.1).holds
        assert [notice.code for notice in held] == [Code.SKIN_SILENT]
        hand.plug()
        time.sleep(1.2)
        assert not tci.run(driver, Feels(), duration=0.3).reason


def test_a_hand_alone_shows_its_pads_as_they_lie(hand: InspireHand) -> None:
    hand.number()
    hand.values["palm"] = [4095 * (k == 7) for k in range(112)]  # row 1, column 1
    hand.values["index_top"] = [4095 * (k == 8) for k in range(96)]  # row 2, column 1
    shown = CliRunner().invoke(app, ["hand", hand.via, "--duration", "0.6"]).stdout
    assert "3.4 N · 4095" in shown, "0.83 mN a count, by one user"
    assert "17 of 17 pads send" in shown
    given = CliRunner().invoke(app, ["hand", hand.via, "--duration", "0.4", "--json"]).stdout
    pads = json.loads(given)["pads"]
    assert {pad: one["values"] for pad, one in pads.items()} == hand.values
    assert all(one["jitter_ms"] < 100.0 for one in pads.values())
    table = {
        pad.name: pad
        for pad in device("inspire-rh56dftp").pads
        if "index" in pad.fingers or pad.name == "palm"
    }
    for name, pad, place in (("palm", "palm", (0, 0)), ("index_top", "top", (1, 0))):
        laid = in_rows(np.array(hand.values[name]), table[pad])
        assert laid.shape == (table[pad].rows, table[pad].columns)
        assert np.argwhere(laid).tolist() == [list(place)]


def test_a_simulated_robot_with_a_real_hand_needs_no_permission_to_move(hand: InspireHand) -> None:
    command = [
        "run",
        "light-grasp",
        "g1-inspire",
        "--via",
        f"sim + {hand.via},side=right",
        "--duration",
        "0.1",
    ]
    assert "read-only" not in CliRunner().invoke(app, command).stdout


def test_which_hand_must_be_said_and_a_robot_without_pads_is_refused(hand: InspireHand) -> None:
    with pytest.raises(DriverError, match="side=left"):
        tci.connect("g1-inspire", f"sim + {hand.via}")
    with pytest.raises(DriverError, match=r"g1 has no patch.*g1-inspire"):
        tci.connect("g1", f"sim + {hand.via}")


@pytest.mark.parametrize("letter", ["l", "r"])
def test_the_makers_topics_give_the_same_pads_and_a_crossed_hand_is_told(letter: str) -> None:
    """Stand-in of the bridge with cyclonedds' own encoder; no second author is known."""
    domain = next(DOMAINS)
    words = [sys.executable, str(HELPERS / "inspire_bridge.py"), str(domain), letter]
    bridge = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    try:
        assert bridge.stdout is not None
        assert bridge.stdout.readline().strip() == "2208", "as long as a message from a robot"
        with tci.connect("g1-inspire", f"sim + inspire:dds://lo/{domain},side=left") as driver:
            end = time.monotonic() + (10.0 if letter == "l" else 1.5)
            ours: dict[str, list[float]] = {}
            while "left_palm" not in ours and time.monotonic() < end:
                time.sleep(0.02)
                frames = [one for one in driver.read().skin if one.patch.startswith("left_")]
                ours = {one.patch: one.values.tolist() for one in frames if not np.isnan(one.values).any()}
            told = [one for one in driver.diagnose() if "rt/inspire_hand" in one.subject]
        if letter == "r":
            (crossed,) = told
            assert "the other hand's topic is there" in crossed.what
            assert "single hand r" in crossed.advice
            return
        assert not told
        flat = [value for pad in INSPIRE for value in ours[f"left_{pad}"]]
        assert flat == [k % 4096 for k in range(1062)], "the order of the registers"
    finally:
        bridge.kill()
        bridge.wait()


def test_a_bridge_that_is_not_started_is_told_with_the_usual_addresses() -> None:
    source = source_at(f"inspire:dds://lo/{next(DOMAINS)},side=left")
    source.open()
    try:
        assert not list(source.read())
        (told,) = source.diagnose()
        assert "nobody publishes rt/inspire_hand/touch/l on lo" in told.what
        assert "start the maker's bridge" in told.advice
        assert "inspire:192.168.123.210 as Unitree sets it up, inspire:192.168.11.210 as sold" in told.advice
    finally:
        source.close()


def test_a_topic_needs_a_side() -> None:
    with pytest.raises(DriverError, match=r"valid: inspire:dds://eth0,side=left"):
        source_at("inspire:dds://lo")
