"""Programs with the vendor's own SDKs, each in a separate process: `python sdk_peer.py ROLE DOMAIN`.

The SDK in C++ (`far-unitree-sdk`) supports only domain 0. Each program prints `ready`. A client program ends
when the robot has moved as requested. A robot program ends when its input is closed. At its end each program
prints one line of JSON with the messages that it has received.
"""

from __future__ import annotations

import json
import os
import struct
import sys
import threading
import time
import types
from contextlib import suppress
from typing import Any

ROLE, DOMAIN = sys.argv[1], int(sys.argv[2])
LONGEST = 60.0
"""Time [s] after which a program ends even if it has not finished."""
LOOPBACK = (
    '<CycloneDDS><Domain Id="any"><General><Interfaces><NetworkInterface name="lo" multicast="false"/>'
    "</Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto"
    "</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>"
    '<Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>'
)
ELBOW, WEIGHT = 18, 29
NO_ANSWER = 3104
"""Code of the SDK for a call that was not answered in time. On a busy machine some answers are lost."""


def times(rate: float) -> Any:
    """Yields the time [s] since the call, `rate` times a second, until the input is closed."""
    closed = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), closed.set()), daemon=True).start()
    begin = due = time.monotonic()
    while (now := time.monotonic()) < begin + LONGEST and not closed.is_set():
        yield now - begin
        due += 1 / rate
        time.sleep(max(0.0, due - time.monotonic()))


def answer(call: Any) -> Any:
    """Returns the answer of the robot's service. Repeats the call until an answer arrives, as TCI's driver
    does."""
    end = time.monotonic() + LONGEST
    while (given := call())[0] == NO_ANSWER and time.monotonic() < end:
        pass
    return given


def tell(**heard: Any) -> None:
    print(json.dumps(heard), flush=True)
    os._exit(0)  # neither SDK stops its threads


def cpp() -> Any:
    import unitree_interface as sdk

    return sdk, sdk.UnitreeInterface.create_g1("lo", sdk.MessageType.HG, dds_config=LOOPBACK)


def python() -> Any:
    sys.modules.setdefault("cv2", types.ModuleType("cv2"))  # only the cameras of the SDK need OpenCV
    import cyclonedds.idl._typesupport.DDS.XTypes as xtypes

    xtypes.TK_UINT8 = xtypes.TK_BYTE  # as in the version of Cyclone DDS that the vendor ships
    import unitree_sdk2py.core.channel as channel

    channel.ChannelConfigHasInterface = LOOPBACK
    channel.ChannelFactoryInitialize(DOMAIN, "lo")
    return channel


def cpp_robot() -> None:
    """A robot whose joints are at the targets of the latest command on rt/lowcmd."""
    sdk, robot = cpp()
    robot.enable_motion_switcher_responder()
    state = sdk.LowState(29)
    state.mode_machine, state.imu.quat = 5, [1.0, 0.0, 0.0, 0.0]
    print("ready", flush=True)
    elbow, stiffness = [], []
    for _ in times(500):
        command = robot.read_incoming_command()
        state.motor.q = list(command.q_target)
        robot.publish_low_state(state)
        elbow.append(command.q_target[ELBOW])
        stiffness.append(command.kp[ELBOW])
    tell(
        largest=max(elbow), last=elbow[-1], stiffest=max(stiffness), stiffness=stiffness[-1],
        damping=command.kd[ELBOW],
    )  # fmt: skip


def cpp_client() -> None:
    """A client that moves the left elbow with rt/lowcmd."""
    _, robot = cpp()
    print("ready", flush=True)
    start = None
    for now in times(250):
        state = robot.read_low_state()
        if state.mode_machine == 5 and start is None:
            start, begin = list(state.motor.q), now
        if start is not None:
            command = robot.create_zero_command()
            wanted = list(start)
            wanted[ELBOW] -= 0.3 * min(1.0, now - begin)
            command.q_target, command.kp, command.kd = wanted, [40.0] * 29, [1.0] * 29
            robot.write_low_command(command)
            if abs(state.motor.q[ELBOW] - start[ELBOW] + 0.3) < 0.01:
                break
    tell(start=start and start[ELBOW], end=state.motor.q[ELBOW], variant=state.mode_machine)


def py_robot() -> None:
    """A robot with rt/arm_sdk and the motion switcher."""
    channel = python()
    from unitree_sdk2py.idl.default import unitree_hg_msg_dds__LowState_
    from unitree_sdk2py.idl.unitree_hg.msg.dds_ import LowCmd_, LowState_
    from unitree_sdk2py.utils.crc import CRC

    crc, state = CRC(), unitree_hg_msg_dds__LowState_()
    state.mode_machine, state.imu_state.quaternion = 5, [1.0, 0.0, 0.0, 0.0]
    elbow, weights, wrong = [], [], 0
    own, here = 0.5, [0.5] * 29

    def hear(command: Any) -> None:
        nonlocal wrong
        wrong += crc.Crc(command) != command.crc
        weights.append(command.motor_cmd[WEIGHT].q)
        for motor in range(12, 29):
            here[motor] = weights[-1] * command.motor_cmd[motor].q + (1 - weights[-1]) * own
        elbow.append(here[ELBOW])

    states = channel.ChannelPublisher("rt/lowstate", LowState_)
    states.Init()
    heard = channel.ChannelSubscriber("rt/arm_sdk", LowCmd_)
    heard.Init(hear, 0)
    print("ready", flush=True)
    for _ in times(125):
        for motor in range(29):
            state.motor_state[motor].q = here[motor]
        state.tick += 8
        state.crc = crc.Crc(state)
        states.Write(state)
    end = time.monotonic() + 5.0
    while weights and weights[-1] and time.monotonic() < end:
        time.sleep(0.1)  # Python may be late, by seconds on a busy machine
    tell(
        commands=len(weights), wrong=wrong, smallest=min(elbow, default=None), last=elbow and elbow[-1],
        largest_weight=max(weights, default=None), weight=weights and weights[-1],
    )  # fmt: skip


def py_log() -> None:
    """A robot that appends each command of rt/arm_sdk to a file, as the struct over which the SDK computes
    its checksum, and prints a dot per command: `sdk_peer.py py_log DOMAIN FILE`."""
    channel = python()
    from unitree_sdk2py.idl.unitree_hg.msg.dds_ import LowCmd_
    from unitree_sdk2py.utils.crc import CRC

    crc, form, wrong = CRC(), struct.Struct("<2B2x" + "B3x5fI" * 35 + "5I"), 0
    with open(sys.argv[3], "wb", buffering=0) as file:

        def hear(command: Any) -> None:
            nonlocal wrong
            wrong += crc.Crc(command) != command.crc
            values = [command.mode_pr, command.mode_machine]
            for motor in command.motor_cmd:
                values += motor.mode, motor.q, motor.dq, motor.tau, motor.kp, motor.kd, motor.reserve
            file.write(form.pack(*values, *command.reserve, command.crc))
            os.write(1, b".")

        heard = channel.ChannelSubscriber("rt/arm_sdk", LowCmd_)
        heard.Init(hear, 0)
        print("ready", flush=True)
        sys.stdin.read()
    tell(wrong=wrong)


def py_hands() -> None:
    """A robot with Dex3 hands and arms. Its fingers are at the targets of the latest commands."""
    channel = python()
    from unitree_sdk2py.idl.default import unitree_hg_msg_dds__LowState_
    from unitree_sdk2py.idl.unitree_hg.msg.dds_ import (
        HandCmd_,
        HandState_,
        IMUState_,
        LowCmd_,
        LowState_,
        MotorState_,
        PressSensorState_,
    )  # fmt: skip
    from unitree_sdk2py.utils.crc import CRC

    crc, state = CRC(), unitree_hg_msg_dds__LowState_()
    state.mode_machine, state.imu_state.quaternion = 5, [1.0, 0.0, 0.0, 0.0]
    imu = IMUState_([1.0, 0.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3, [0.0] * 3, 30)
    heard: dict[str, Any] = {"left": [], "right": []}
    readers, writers, q = {}, {}, {"left": [-0.1] * 7, "right": [0.1] * 7}
    for side, angles in q.items():

        def hear(command: Any, angles: Any = angles, messages: Any = heard[side]) -> None:
            messages.append([(motor.mode, motor.q, motor.kp) for motor in command.motor_cmd])
            for motor in command.motor_cmd:
                if motor.mode >> 4 & 7:
                    angles[motor.mode & 0x0F] = motor.q

        readers[side] = channel.ChannelSubscriber(f"rt/dex3/{side}/cmd", HandCmd_)  # freed: a crash
        readers[side].Init(hear, 0)
        writers[side] = channel.ChannelPublisher(f"rt/dex3/{side}/state", HandState_)
        writers[side].Init()
    states = channel.ChannelPublisher("rt/lowstate", LowState_)
    states.Init()
    arms = channel.ChannelSubscriber("rt/arm_sdk", LowCmd_)
    arms.Init(lambda command: None, 0)
    pads = [
        PressSensorState_([1e5 + 10.0 * pad + one for one in range(12)], [0.0] * 12, 0, 0) for pad in range(9)
    ]
    print("ready", flush=True)
    for _ in times(125):
        state.tick += 8
        state.crc = crc.Crc(state)
        states.Write(state)
        for side, writer in writers.items() if state.tick % 3 == 0 else ():  # Python is late already
            motors = [MotorState_(i, a, 0.0, 0.0, 0.0, [30, 30], 0.0, [0, 0], 0, [0] * 4)
                      for i, a in enumerate(q[side])]  # fmt: skip
            writer.Write(HandState_(motors, pads, imu, 0.0, 0.0, 0.0, 0.0, [0, 0], [0, 0]))
    tell(left=q["left"], right=q["right"], first=heard["left"][:1], last=heard["left"][-1:])


def py_client() -> None:
    """A client that queries the motion switcher and moves the left elbow with rt/arm_sdk."""
    channel = python()
    from unitree_sdk2py.comm.motion_switcher.motion_switcher_client import MotionSwitcherClient
    from unitree_sdk2py.idl.default import unitree_hg_msg_dds__LowCmd_
    from unitree_sdk2py.idl.unitree_hg.msg.dds_ import LowCmd_, LowState_
    from unitree_sdk2py.utils.crc import CRC

    crc, command, elbow, wrong = CRC(), unitree_hg_msg_dds__LowCmd_(), [], 0

    def hear(state: Any) -> None:
        nonlocal wrong
        wrong += crc.Crc(state) != state.crc
        elbow.append((state.motor_state[ELBOW].q, state.mode_machine))

    heard = channel.ChannelSubscriber("rt/lowstate", LowState_)
    heard.Init(hear, 0)
    arms = channel.ChannelPublisher("rt/arm_sdk", LowCmd_)
    arms.Init()
    switcher = MotionSwitcherClient()
    switcher.SetTimeout(3.0)
    switcher.Init()
    print("ready", flush=True)
    while (before := switcher.CheckMode())[0]:  # until it is connected
        time.sleep(0.1)
    while not elbow:
        time.sleep(0.01)
    start = elbow[-1][0]
    for now in times(50):
        motor = command.motor_cmd[ELBOW]
        motor.mode, motor.q, motor.kp, motor.kd = 1, start + 0.3 * min(1.0, now), 60.0, 1.5
        command.motor_cmd[WEIGHT].q = min(1.0, now)
        command.mode_machine = elbow[-1][1]
        command.crc = crc.Crc(command)
        arms.Write(command)
        if abs(elbow[-1][0] - start - 0.3) < 0.01:
            break
    end = elbow[-1][0]
    released, after = answer(switcher.ReleaseMode)[0], answer(switcher.CheckMode)
    tell(before=before, released=released, after=after, start=start, end=end, states=len(elbow), wrong=wrong)


if ROLE in ("cpp_robot", "py_robot", "py_hands"):
    # real time as on a robot, where the loop does not wait for other programs
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))
globals()[ROLE]()
