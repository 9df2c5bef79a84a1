"""LCM: TCI's receiver, the messages of lcm-gen, and Debian's programs lcm-logger and lcm-logplayer."""

from __future__ import annotations

import os
import random
import signal
import struct
import subprocess
import sys
import time
import zlib
from pathlib import Path

import lcm
import numpy as np
import pytest

import tci
from helpers.lcm_messages import WHOLE, pieces, short
from helpers.patient import patient
from helpers.peers import needs_program
from helpers.remote_messages import NAO, plain
from helpers.wire_peers import Lcm, lcm_url
from tci.drivers.driver import Driver
from tci.errors import DriverError, FrameError
from tci.gate.safe_command import GateState
from tci.messages.clock import ManualClock
from tci.wires.lcm.datagrams import (
    LONGEST,
    PATIENCE,
    PIECE,
    SENDERS,
    Datagrams,
    Receiver,
    Transmitter,
    parse_url,
)
from tci.wires.lcm.driver import LcmDriver
from tci.wires.lcm.encoding import (
    to_state,
)
from tci.wires.lcm.tci_lcm import orders_t, state_t

TYPES = Path(tci.__file__).parent / "wires" / "lcm" / "tci_lcm"


def test_types_are_those_that_lcm_gen_makes(tmp_path: Path) -> None:
    generator = Path(sys.executable).with_name("lcm-gen")
    options = ["-p", "--package-prefix", "tci.wires.lcm", "--ppath", str(tmp_path)]
    subprocess.run([generator, *options, TYPES / "tci.lcm"], check=True)
    made = tmp_path / "tci" / "wires" / "lcm" / "tci_lcm"
    assert (
        {file.name for file in made.glob("*_t.py")} == {file.name for file in TYPES.glob("*_t.py")} != set()
    )
    for file in made.glob("*.py"):
        assert (TYPES / file.name).read_text() == file.read_text(), f"make it again: lcm-gen {file.name}"


@pytest.mark.parametrize(("read", "before", "data"), WHOLE)
def test_what_arrives_is_what_was_sent(read: object, before: object, data: bytes) -> None:
    assert plain(read(NAO, data)) == plain(before)


def test_wrong_types_damage_and_other_robots_are_refused() -> None:
    other = NAO.model_copy(update={"digest": "0123456789abcdef" * 4})
    for read, _, data in WHOLE:
        with pytest.raises(FrameError, match="0123456789abcdef"):
            read(other, data)
        with pytest.raises(FrameError):
            read(NAO, data[:-1])
        for bit in range(0, 8 * len(data), 7):
            damaged = bytearray(data)
            damaged[bit // 8] ^= 1 << bit % 8
            with pytest.raises(FrameError):
                read(NAO, bytes(damaged))
    with pytest.raises(FrameError, match="state_t"):
        to_state(NAO, WHOLE[2][2])


def test_a_message_of_another_version_is_told_from_a_damaged_one() -> None:
    body = bytes([WHOLE[0][2][0] ^ 1]) + WHOLE[0][2][1:-4]
    with pytest.raises(
        FrameError, match="no state_t of this version of TCI; valid: the same version on both"
    ):
        to_state(NAO, body + struct.pack(">I", zlib.crc32(body)))


def test_what_lcm_itself_sends_is_read_whole_or_in_pieces() -> None:
    url = lcm_url(ttl=1)  # the LCM library can't use the loopback interface
    receiver, sender = Receiver(url), lcm.LCM(url)
    bodies = [b"", b"x" * 1400, b"y" * 100_000, b"z" * LONGEST]
    for body in bodies:
        sender.publish("a/b", body)
        found = []
        while not found:
            found = [(channel, data) for channel, data, _ in receiver.poll()]
        assert found == [("a/b", body)]
    assert (receiver.datagrams.lost, receiver.datagrams.rejected) == (0, 0)
    receiver.close()


@pytest.mark.parametrize("ttl", [0, 1])
def test_what_is_sent_is_read_whole_by_lcms_own_logger_and_here(ttl: int, tmp_path: Path) -> None:
    logger, log = needs_program("/usr/bin/lcm-logger", "liblcm-bin"), tmp_path / "sent.log"
    url = lcm_url(ttl)
    receiver, sender = Receiver(url), Transmitter(url)
    bodies = [b"", b"x" * 1400, *(b"y" * (PIECE - 4 + more) for more in (-1, 0, 1)), b"z" * 80_000]
    with subprocess.Popen([logger, f"--lcm-url={url}", "--quiet", log]) as recording:
        end = time.monotonic() + 40.0
        while not (log.exists() and log.stat().st_size) and time.monotonic() < end:
            sender.send("first", b"is it there?")
            time.sleep(0.05)
        for body in bodies:
            sender.send("a/b", body)
            time.sleep(0.05)
        assert [data for channel, data, _ in receiver.poll() if channel == "a/b"] == bodies
        recording.send_signal(signal.SIGINT)
    assert [event.data for event in lcm.EventLog(str(log)) if event.channel == "a/b"] == bodies
    receiver.close()
    sender.close()


def test_32_one_look_finds_the_latest_of_all_that_waits() -> None:
    url = lcm_url()
    receiver, sender = Receiver(url), Transmitter(url)
    for number in range(150):
        sender.send("a/b", bytes([number]))
    # Data sent on the same machine arrive without delay.
    assert list(receiver.poll())[-1][:2] == ("a/b", bytes([149]))
    receiver.close()
    sender.close()


def test_a_network_that_goes_away_ends_nobody_and_one_that_never_was_is_told() -> None:
    class Broken:
        def send(self, channel: str, data: bytes) -> None:
            raise OSError(101, "Network is unreachable")

    peer = Lcm()
    peer.start()
    try:
        with peer.open(arm=True) as driver:
            assert isinstance(driver, LcmDriver)
            sound, driver._bus.transmitter = driver._bus.transmitter, Broken()
            with pytest.raises(DriverError, match="the network accepts no data: Network is unreachable"):
                driver.write(driver.gate.step([], driver.read().joints, driver.clock.now()))
            driver._bus.transmitter = sound
            driver.write(driver.gate.step([], driver.read().joints, driver.clock.now()))
            driver._bus.transmitter = Broken()
            driver.write(driver.gate.step([], driver.read().joints, driver.clock.now()))
            driver._bus.transmitter = sound
    finally:
        peer.stop()


def test_losses_are_counted_by_the_senders_numbers() -> None:
    seen = Datagrams()
    for number in (5, 6, 9, 9, 8, 10):
        seen.take(short(number), "one")
    seen.take(short(3), "another")
    seen.take(short(2**32 - 1), "third")
    assert seen.take(short(0), "third") == ("c", b"body")
    assert (seen.lost, seen.rejected) == (2, 2)


def test_pieces_in_any_order_make_one_message_and_copies_none() -> None:
    seen = Datagrams()
    first, second, third = pieces(1, bytes(range(250)), 3)
    assert seen.take(third, "a") is None
    assert seen.take(third, "a") is None
    assert seen.take(first, "a") is None
    assert seen.take(second, "a") == ("c", bytes(range(250)))
    assert seen.take(second, "a") is None
    assert seen.rejected == 2


def test_30_pieces_that_stay_away_are_dropped_after_a_time() -> None:
    clock = ManualClock()
    seen = Datagrams(clock.now)
    first, second = pieces(1, b"z" * 100, 2)
    seen.take(first, "a")
    clock.advance(PATIENCE * 2)
    assert seen.take(second, "a") is None
    assert seen.take(pieces(2, b"z" * 100, 2)[0], "a") is None
    assert seen.take(pieces(2, b"z" * 100, 2)[1], "a") == ("c", b"z" * 100)


def test_31_declared_sizes_are_refused_before_anything_is_kept() -> None:
    seen = Datagrams()
    for size in (0, 2**31 - 1, 2**32 - 1, LONGEST + 1):
        head = b"LC03" + (1).to_bytes(4, "big") + size.to_bytes(4, "big") + bytes(6) + b"\xff\xff"
        assert seen.take(head + b"c\0" + b"x" * 1000, size) is None
    assert seen.rejected == 4
    for sender in range(10 * SENDERS):
        seen.take(pieces(1, b"x" * 1000, 2)[0], sender)
    assert len(seen._senders) <= SENDERS


def test_damaged_datagrams_never_raise() -> None:
    """Some of these datagrams crash LCM's own receiver. TCI_FUZZ_WIRE sets their number."""
    chance, seen = random.Random(2), Datagrams()
    good = [short(1, b"tci/nao/state", WHOLE[0][2]), *pieces(2, WHOLE[1][2] * 3, 3), *pieces(3, b"q" * 50, 2)]
    for _ in range(int(os.environ.get("TCI_FUZZ_WIRE", "20000"))):
        data = bytearray(chance.choice(good))
        for _ in range(chance.randint(0, 6)):
            data[chance.randrange(min(len(data), 60))] = chance.randrange(256)
        whole = seen.take(bytes(data[: chance.randint(0, len(data))]), chance.randrange(3))
        if whole is not None:
            for read, _, _ in WHOLE:
                try:
                    read(NAO, whole[1])
                except FrameError:
                    continue


@pytest.mark.parametrize(
    "url",
    ["udpm://10.0.0.1:7667", "tcp://239.255.76.67:7667", "udpm://239.255.76.67", "udpm://239.1.1.1:99999"],
)
def test_a_wrong_url_says_what_is_valid(url: str) -> None:
    with pytest.raises(DriverError, match="valid: udpm"):
        parse_url(url)


def test_nobody_there_is_told() -> None:
    with pytest.raises(DriverError, match="tci serve ROBOT --via lcm"):
        LcmDriver(NAO, lcm_url())


@pytest.mark.timeout(120)
def test_debians_lcm_logger_records_and_its_logplayer_shows_the_robot_again_but_moves_nothing(
    tmp_path: Path,
) -> None:
    logger, player = needs_program("/usr/bin/lcm-logger", "liblcm-bin"), "/usr/bin/lcm-logplayer"
    peer = Lcm(ttl=1)  # Debian's programs can't use the loopback interface
    peer.start()
    url, log = peer.via.removeprefix("lcm:"), tmp_path / "run.log"
    try:
        with subprocess.Popen([logger, f"--lcm-url={url}", "--quiet", log]) as recording:
            try:
                end = time.monotonic() + 30.0
                while not (
                    log.exists() and log.stat().st_size
                ):  # messages that were sent before the logger listens are missing
                    assert time.monotonic() < end, "it never records"
                    time.sleep(0.01)
                with peer.open(arm=True) as driver:
                    for angle in (-0.3, -1.2):
                        assert bend(driver, angle) == pytest.approx(angle, abs=0.05)
            finally:
                recording.send_signal(signal.SIGINT)
        channels = {}
        for event in lcm.EventLog(str(log)):
            channels.setdefault(event.channel, []).append(event.data)
        assert set(channels) == {"tci/nao/state", "tci/nao/skin", "tci/nao/orders"}
        ordered = [orders_t.decode(data) for data in channels["tci/nao/orders"]]
        assert sum(order.num_orders for order in ordered) >= 1
        assert state_t.decode(channels["tci/nao/state"][-1]).position[0] == pytest.approx(0.0, abs=3.0)

        # moves the robot to another position, so that an effect of the replayed orders would be seen
        with peer.open(arm=True) as driver:
            assert bend(driver, -0.5) == pytest.approx(-0.5, abs=0.05)
        subprocess.run([player, f"--lcm-url={url}", log], check=True, capture_output=True, timeout=60)
        with peer.open(arm=False) as driver:
            assert elbow(driver) == pytest.approx(-0.5, abs=0.05)
    finally:
        peer.stop()
    play = [player, f"--lcm-url={url}", log]
    with (
        subprocess.Popen(play, stdout=subprocess.DEVNULL) as playing,
        LcmDriver(patient("nao"), url) as shown,
    ):
        elbows = []
        while playing.poll() is None:
            elbows.append(elbow(shown))
            time.sleep(0.01)
    assert np.ptp(elbows) > 0.1


def elbow(driver: Driver) -> float:
    return driver.native("LArm").positions(driver.read().joints)["LElbowRoll"]


def bend(driver: Driver, to: float) -> float:
    """Bends the left elbow and returns its final angle [rad]. Repeats the order if a busy machine made the
    robot hold."""
    order = driver.native("LArm").command({"LElbowRoll": to})
    pending = [order]
    for now in driver.ticks(duration=30.0):
        sent = driver.write(driver.gate.step(pending, driver.read().joints, now))
        pending = [order] if sent.refusals or sent.state is not GateState.RUN else []
        if abs(elbow(driver) - to) < 0.02:
            break
    return elbow(driver)
