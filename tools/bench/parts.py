"""Benchmarks of parts of the pipeline: contacts, gate, kinematics, inverse kinematics."""

from __future__ import annotations

import json
import subprocess

import mujoco
import numpy as np
import pinocchio
from measured import ROUNDS, Measured, Work, each, in_turn, row
from ruckig import InputParameter, OutputParameter, Ruckig
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

import tci
from tci.body.posture import to_platform
from tci.exports.chain import chain_to
from tci.exports.urdf import to_urdf
from tci.gate import Gate
from tci.messages import GenericCommand, JointReading, Mode
from tci.messages.frames import frozen
from tci.robot.inverse import InverseKinematics
from tci.robot.joint_map import initial_position
from tci.robot.kinematics import KinematicChain
from tci.robot.model_file import load_spec
from tci.skin.contacts import ContactFinder, ContactSettings
from tci.skin.kernels.arrays import ActiveTaxels
from tci.skin.kernels.contacts import cluster
from tci.skin.layout import SkinLayout
from tci.skin.skin import Skin


def gate_and_ruckig(robot: tci.Robot) -> tuple[Work, Work]:
    """Times the whole gate with five moving joints, including the check for a safe stop, and one update of
    ruckig."""
    gate = Gate(robot, period=0.002, stale_after=0.05)
    position = np.array(initial_position(robot))
    near, far = robot.part("left_arm").initial_posture, np.deg2rad([60.0, 60.0, 30.0, 40.0, 30.0])
    commands = [
        to_platform(robot, GenericCommand("left_arm", Mode.POSITION, target)) for target in (near, far)
    ]
    count = 0

    still = np.zeros(len(position))

    def ours() -> object:
        nonlocal count
        count += 1
        joints = JointReading(0.002 * count, count, position.copy(), still)
        orders = [commands[count // 40 % 2]] if count % 40 == 0 else []
        safe = gate.step(orders, joints, 0.002 * count)
        position[safe.servos] = safe.position
        return safe

    motion, request, answer = Ruckig(5, 0.002), InputParameter(5), OutputParameter(5)
    request.max_velocity, request.max_acceleration, request.max_jerk = [5.0] * 5, [60.0] * 5, [4800.0] * 5
    ticks = 0

    def peer() -> object:
        nonlocal ticks
        ticks += 1
        request.target_position = [0.5 if ticks // 40 % 2 else -0.5] * 5
        result = motion.update(request, answer)
        answer.pass_to_input(request)
        return result

    return ours, peer


def clusters_and_scipy(robot: tci.Robot) -> tuple[Work, Work]:
    """Times single-link clustering of one touch: TCI on the neighbour graph of the surface, SciPy on a k-d
    tree."""
    skin = Skin(robot)
    layout, surface = SkinLayout.of_robot(robot), skin.surfaces["left_forearm"]
    distance = np.linalg.norm(surface.positions - surface.positions[100], axis=1)
    forces = np.where(distance < 0.015, 0.5, 0.0)
    settings, clusters = ContactSettings(), ContactFinder(layout)._clusters
    onset = np.full(len(layout.arrays.taxels), np.inf)
    place, touched = layout.places["left_forearm"], np.flatnonzero(forces)
    begin = np.zeros(len(layout.sites) + 1, np.int64)
    begin[place + 1 :] = len(touched)
    pressure = (forces / surface.areas)[touched]
    state = ActiveTaxels(*map(frozen, (np.zeros(len(begin) - 1), begin, touched.astype(np.int32), pressure)))

    def ours() -> object:
        return cluster(state, settings.limits, onset, layout.arrays, clusters)

    def peer() -> object:
        active = np.flatnonzero(forces > settings.floor)
        pairs = cKDTree(surface.positions[active]).query_pairs(0.015, output_type="ndarray")
        size = len(active)
        graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(size, size))
        return connected_components(graph, directed=False)

    return ours, peer


def kinematics_and_mujoco(robot: tci.Robot, *, in_loop: bool) -> tuple[Work, Work]:
    """Times the poses of four links in the torso frame. TCI computes them from joint angles, through its
    public method or, with `in_loop`, through the method that the control loop uses. MuJoCo runs only
    mj_kinematics."""
    kinematics, position = KinematicChain(robot), initial_position(robot)
    links = tuple(patch.link for patch in robot.patches)
    assert robot.model is not None
    model = load_spec(robot.model).compile()
    data = mujoco.MjData(model)
    ours = kinematics.pose_array if in_loop else kinematics.poses
    return lambda: ours(position, links), lambda: mujoco.mj_kinematics(model, data)


def kinematics_and_pinocchio(robot: tci.Robot) -> tuple[Work, Work]:
    """Times pose and Jacobian of a hand: TCI computes them in the torso frame, Pinocchio in the world
    frame."""
    kinematics, position = KinematicChain(robot), initial_position(robot)
    model = pinocchio.buildModelFromXML(to_urdf(robot))
    data, q, frame = model.createData(), pinocchio.neutral(model), model.getFrameId("LHand")
    world = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
    return (
        lambda: kinematics.pose_and_jacobian(position, "LHand"),
        lambda: pinocchio.computeFrameJacobian(model, data, q, frame, world),
    )


def inverse_and_kdl(robot: tci.Robot) -> tuple[Work, Work] | None:
    """Times inverse kinematics of a hand: TCI with joint limits, KDL's LMA without joint limits, in Debian's
    Python.

    Returns None if python3-pykdl is not installed.
    """
    segments = [segment.model_dump(mode="json") for segment in chain_to(robot, "LHand")]
    kinematics = KinematicChain(robot)
    servos = [segment["servo"] for segment in segments if segment["servo"] is not None]
    limits = [robot.servos[servo].limits for servo in servos]
    random, targets = np.random.default_rng(0), []
    for _ in range(100):
        posture = initial_position(robot).copy()
        posture[servos] = random.uniform([limit.lower for limit in limits], [limit.upper for limit in limits])
        targets.append(kinematics.poses(posture, ["LHand"])["LHand"])
    start = initial_position(robot)[servos].tolist()
    request = json.dumps({"segments": segments, "targets": [t.tolist() for t in targets], "start": start})
    try:
        child = subprocess.Popen(
            ["/usr/bin/python3", "-c", KDL], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
    except OSError:
        return None
    assert child.stdin is not None
    assert child.stdout is not None
    child.stdin.write(request + "\n")
    child.stdin.flush()
    if child.stdout.readline() != "ready\n":
        return None
    inverse = InverseKinematics(robot, kinematics, "LHand")
    count = 0

    def ours() -> object:
        nonlocal count
        count += 1
        return inverse.solve(targets[count % len(targets)], initial_position(robot))

    def peer() -> float:
        """Returns the time [us] of one solution by KDL, measured in a separate process."""
        child.stdin.write("go\n")
        child.stdin.flush()
        return float(child.stdout.readline())

    return ours, peer


KDL = """
import json, sys, time
try:
    import PyKDL as kdl
except ImportError:
    sys.exit()
request = json.loads(sys.stdin.readline())
def frame(rows):
    R = kdl.Rotation(*[v for row in rows[:3] for v in row[:3]])
    return kdl.Frame(R, kdl.Vector(*[row[3] for row in rows[:3]]))
chain = kdl.Chain()
for s in request["segments"]:
    joint = kdl.Joint(s["name"]) if s["servo"] is None else kdl.Joint(
        s["name"], kdl.Vector(*s["origin"]), kdl.Vector(*s["axis"]), kdl.Joint.RotAxis)
    chain.addSegment(kdl.Segment(s["name"], joint, frame(s["tip"])))
solver = kdl.ChainIkSolverPos_LMA(chain)
start, found = kdl.JntArray(len(request["start"])), kdl.JntArray(len(request["start"]))
for i, value in enumerate(request["start"]):
    start[i] = value
targets = [frame(rows) for rows in request["targets"]]
print("ready", flush=True)
for _ in sys.stdin:
    begin = time.thread_time()
    for target in targets:
        solver.CartToJnt(start, target, found)
    print((time.thread_time() - begin) / len(targets) * 1e6, flush=True)
"""


def contacts() -> list[Measured]:
    pairs = in_turn(*clusters_and_scipy(tci.load_robot("nao")))
    return [row("clusters of one touch", "SciPy: k-d tree, connected components", pairs, most_ratio=1.0)]


def gate() -> list[Measured]:
    return [
        row("gate, 5 joints moving", "one update of ruckig", in_turn(*gate_and_ruckig(tci.load_robot("nao"))))
    ]


def kinematics() -> list[Measured]:
    nao = tci.load_robot("nao")
    asked, looped = (in_turn(*kinematics_and_mujoco(nao, in_loop=one)) for one in (False, True))
    return [
        row("forward kinematics, 4 links", "mj_kinematics", asked),
        row("forward kinematics, 4 links, in the control loop", "mj_kinematics", looped),
        row("pose and Jacobian of a hand", "Pinocchio", in_turn(*kinematics_and_pinocchio(nao))),
    ]


def inverse() -> list[Measured]:
    """Returns the rows of inverse kinematics. KDL runs in Debian's Python and is timed there."""
    found = inverse_and_kdl(tci.load_robot("nao"))
    if found is None:
        raise SystemExit("KDL is not installed; as root: apt-get install python3-pykdl")
    ours, peer = found
    pairs = [(each(ours, calls=100), float(str(peer()))) for _ in range(ROUNDS)]
    return [row("inverse kinematics, poses of a hand", "KDL (LMA, no limits)", pairs)]
