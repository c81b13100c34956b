"""How to read servos with as few packets as they understand."""

from __future__ import annotations

from collections.abc import Sequence

from head_tracking.dynamixel.bus_servo import BusServo
from head_tracking.dynamixel.port import ReadGroup, ReadMethod

Plan = list[tuple[ReadGroup, list[BusServo]]]


class ReadingPlan:
    """Groups servos that can be read together.

    A servo that did not answer last time is asked alone: others would wait for its turn to pass.
    The plan stays the same object as long as the same servos are read, so that the port can keep
    its packets.
    """

    def __init__(self) -> None:
        self._servos: list[BusServo] = []
        self._alone: list[bool] = []
        self._plan: Plan = []

    def groups(self, servos: list[BusServo]) -> Plan:
        """Return the groups of servos to read, in order."""
        alone = [servo.failed_cycles > 0 for servo in servos]
        if servos != self._servos or alone != self._alone:
            self._servos, self._alone = servos, alone
            self._plan = _plan(servos)
        return self._plan


def _plan(servos: Sequence[BusServo]) -> Plan:
    by_kind: dict[tuple[ReadMethod, int, int, int], list[BusServo]] = {}
    for servo in servos:
        model = servo.mount.model
        key = (_method(servo), model.protocol, model.feedback.address, model.feedback.length)
        by_kind.setdefault(key, []).append(servo)
    return [
        (
            ReadGroup(
                method if len(members) > 1 else ReadMethod.EACH,
                protocol,
                address,
                length,
                tuple(servo.id for servo in members),
            ),
            members,
        )
        for (method, protocol, address, length), members in by_kind.items()
    ]


def _method(servo: BusServo) -> ReadMethod:
    model, identity = servo.mount.model, servo.identity
    if servo.failed_cycles:
        return ReadMethod.EACH
    if model.protocol == 1:
        return ReadMethod.BULK if model.bulk_read else ReadMethod.EACH
    knows_fast = (
        model.fast_sync_read is not None
        and identity is not None
        and identity.firmware_version >= model.fast_sync_read
    )
    return ReadMethod.FAST_SYNC if knows_fast else ReadMethod.SYNC
