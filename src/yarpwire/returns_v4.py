"""Structure of the answer to each method of YARP 4.0's control boards.

The answer to a refused call also contains the whole structure. A client reads all fields of this structure,
and would wait for a missing field.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from yarpwire.values import Loose, Vocab

OK, FAIL = Vocab("ok"), Vocab("fail")
NOT_IMPLEMENTED = Vocab("err2")
"""Result of a method that served boards do not implement, such as reading the gains of a PID controller."""
METHOD_FAILED = Vocab("err5")
"""Result of a call that has wrong arguments or that the robot refuses."""
EMPTY: dict[str, Any] = {
    "double": 0.0, "int": 0, "bool": FAIL, "string": "", "list": [],
    "pid": [0.0] * 10, "pid_info": [""] * 13,
}  # fmt: skip
"""Values of the fields in the answer to a refused call, by the type of the field."""

_METHODS = {
    "": """
        abortCalibration abortPark calibrateAxisWithParams calibrateRobot calibrateSingleJoint
        calibrateWholePart calibrationDone disableAmp disablePid enableAmp enablePid homingSingleJoint
        homingWholePart park parkSingleJoint parkWholePart positionMoveAll positionMoveGroup positionMoveOne
        quitCalibrate quitPark relativeMoveAll relativeMoveGroup relativeMoveOne resetEncoderAll
        resetEncoderOne resetMotorEncoder resetMotorEncoders resetPid setAutoBrakeEnabled
        setCalibrationParameters setControlModeAll setControlModeGroup setControlModeOne setEncoderAll
        setEncoderOne setGearboxRatio setImpedance setImpedanceOffset setInteractionModeOne
        setInteractionModesAll setInteractionModesGroup setManualBrakeActive setMaxCurrent setMotorEncoder
        setMotorEncoderCountsPerRevolution setMotorEncodersAll setMotorTorqueParams setNominalCurrent
        setPWMLimit setPeakCurrent setPid setPidErrorLimit setPidErrorLimits setPidFeedforwardOne
        setPidOffsetOne setPidReference setPidReferences setPids setPosLimits setRefCurrentAll
        setRefCurrentGroup setRefCurrentOne setRefDutyCycleAll setRefDutyCycleGroup setRefDutyCycleOne
        setRefPositionAll setRefPositionGroup setRefPositionOne setRefTorqueAll setRefTorqueGroup
        setRefTorqueOne setRefVelocityAll setRefVelocityGroup setRefVelocityOne setRemoteVariable
        setTemperatureLimit setTrajAccelerationOne setTrajAccelerationsAll setTrajAccelerationsGroup
        setTrajSpeedAll setTrajSpeedGroup setTrajSpeedOne setVelLimits stopAll stopGroup stopOne
        velocityMoveAll velocityMoveGroup velocityMoveOne""",
    "list": """
        getAmpStatusAll getAvailableControlModes getAvailablePids getCurrentAll getDeviceInterfaces
        getDutyCycleAll getEncoderAccelerationAll getEncoderAll getEncoderSpeedAll getInteractionModesAll
        getInteractionModesGroup getMotorEncoderAccelerationAll getMotorEncoderAll getMotorEncoderSpeedAll
        getPidErrorLimits getPidErrors getPidExtraInfos getPidOutputs getPidReferences getPids
        getRefCurrentAll getRefDutyCycleAll getRefPositionAll getRefPositionGroup getRefTorqueAll
        getRefTorqueGroup getRefVelocityAll getRefVelocityGroup getRemoteVariable getRemoteVariablesList
        getTargetPositionAll getTargetPositionGroup getTargetVelocityAll getTargetVelocityGroup
        getTemperatureAll getTrajAccelerationAll getTrajAccelerationGroup getTrajSpeedsAll
        getTrajSpeedsGroup""",
    "list list": "getCurrentRangeAll getEncoderTimedAll getMotorEncodersTimedAll getTorqueRangeAll",
    "bool": """
        checkMotionDoneAll checkMotionDoneGroup checkMotionDoneOne getAutoBrakeEnabled
        isCalibratorDevicePresent isJointBraked isPidEnabled""",
    "double": """
        getCurrentOne getDutyCycleOne getEncoderAccelerationOne getEncoderOne getEncoderSpeedOne
        getGearboxRatio getImpedanceOffset getMaxCurrent getMotorEncoderAccelerationOne
        getMotorEncoderCountsPerRevolution getMotorEncoderOne getMotorEncoderSpeedOne getNominalCurrent
        getPWM getPWMLimit getPeakCurrent getPidError getPidErrorLimit getPidFeedforward getPidOffset
        getPidOutput getPidReference getPowerSupplyVoltage getRefCurrentOne getRefDutyCycleOne
        getRefPositionOne getRefTorqueOne getRefVelocityOne getTargetPositionOne getTargetVelocityOne
        getTemperatureLimit getTemperatureOne getTrajAccelerationOne getTrajSpeedOne""",
    "double double": """
        getCurrentRangeOne getEncoderTimedOne getImpedance getMotorEncoderTimedOne getPosLimits
        getTorqueRangeOne getVelLimits""",
    "double double double double": "getCurrentImpedanceLimit",
    "int": """
        getAmpStatusOne getAxes getInteractionModeOne getJointType getNumberOfMotorEncoders
        getNumberOfMotors""",
    "int string": "getLastJointFault",
    "string": "getAxisName",
    "pid": "getPid",
    "pid_info": "getPidExtraInfo",
    " ".join(["double"] * 9): "getMotorTorqueParams",
}  # fmt: skip

RETURNS = {
    f"{name}RPC": tuple(fields.split()) for fields, names in _METHODS.items() for name in names.split()
}
"""Types of the fields that follow the result code (`ok` or an error) in the answer to each method."""


def reply(method: str, found: Sequence[Any] | None) -> list[Any]:
    """Returns the reply to an executed call: `[ok]` if the method returns no fields, otherwise `([ok])` and
    the fields `found`."""
    return _structure(method, OK, found or ())


def refusal(method: str, result: Vocab) -> list[Any]:
    """Returns the reply to a refused call: `result`, and every field of the method's structure."""
    return _structure(method, result, [EMPTY[field] for field in RETURNS[method]])


def _structure(method: str, result: Vocab, fields: Sequence[Any]) -> list[Any]:
    return [Loose([result]), *fields] if RETURNS[method] else Loose([result])


def explain(method: str = "") -> list[Any]:
    """Returns the reply to `help`: the names of all methods, or the fields that `method` returns."""
    lines = ["*** Available commands:", *sorted(RETURNS), "help"]
    if method in RETURNS:
        lines = [f"{method} returns: {', '.join(('result', *RETURNS[method]))}"]
    elif method:
        lines = [f"{method} is not known; valid: the names that help lists"]
    return [Vocab("many"), lines]
