"""servo set, set-id, set-baud and relax."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Final

from head_tracking.cli.servo.register_values import as_text, find_register, parse_value
from head_tracking.cli.servo.session import (
    Session,
    ToolError,
    find_servo,
    first_ids,
    none_answers,
    protocol_of,
)
from head_tracking.dynamixel.control_table import Register
from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ServoError,
)
from head_tracking.dynamixel.models import ServoModel, servo_model
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.protocol import BROADCAST_ID
from head_tracking.dynamixel.servo import EEPROM_PAUSE, Servo, run
from head_tracking.dynamixel.torque import pin, require_straight_path
from head_tracking.exceptions import RefusedError

_TRIES: Final = 3
_BROADCASTS: Final = 3  # of each packet: one may be lost
_GOALS: Final = ("Goal Position", "Moving Speed", "Goal Velocity", "Goal PWM", "Goal Current")


def set_register(session: Session, servo_id: int, name: str, text: str) -> None:
    """Write a register of a servo."""
    with session.port() as port:
        servo = find_servo(port, servo_id, session.model)
        register = find_register(servo.model.control_table, name)
        value = parse_value(servo.model, register, text)
        name = register.name
        if name == "ID" and value != servo_id and protocol_of(port, value) is not None:
            raise RefusedError(
                f"id {value} is used by another servo; give another id, or disconnect that servo"
            )
        if name == "ID" and session.model is None:
            servo.read_feedback(_TRIES)  # corrupt if two servos have the old id
        if register.eeprom and name != "Status Return Level":
            try:
                servo.require_writable_memory()
            except ServoError as refusal:
                raise RefusedError(str(refusal)) from refusal
        meaning = as_text(servo.model, register, value)
        shown = f"{name} = {value}{meaning and f', {meaning}'}"
        if name not in ("ID", "Baud Rate"):
            _write(session, servo, register, value, shown)
    if name in ("ID", "Baud Rate"):
        _readdress(session, servo, name, value, shown)
    session.terminal.show(f"servo {servo_id}: {shown}")


def _write(session: Session, servo: Servo, register: Register, value: int, shown: str) -> None:
    name = register.name
    if name == "Status Return Level":
        _set_return_level(session, servo, register, value)
    elif register.eeprom:
        _ask(session, servo, f"{shown} (now {servo.get(name)})")
        run(servo.write_eeprom({name: value}), session.pause)
    elif name == "Torque Enable" and value == 1:
        _switch_torque_on(session, servo)
    else:
        if name == "Lock":
            _ask(session, servo, shown)
        if name in _GOALS:
            _check_goal(session, servo, name, value)
        servo.set(name, value)


def _readdress(session: Session, servo: Servo, name: str, value: int, shown: str) -> None:
    """Change the id or the baud rate of a servo, and check that it answers."""
    is_id = name == "ID"
    new_id = value if is_id else servo.id
    rate = session.baud_rate if is_id else servo.model.baud_rates[value]
    with session.port(rate):
        pass  # the adapter supports it
    _ask(session, servo, shown)
    with session.port() as port:
        servo = find_servo(port, servo.id, servo.model)
        run(servo.lock_eeprom(False))
        servo.write(servo.model.control_table.block(name), value)
        session.pause(EEPROM_PAUSE)
    with session.port(rate) as port:
        if protocol_of(port, new_id) is None:
            raise ToolError(
                f"id {new_id} does not answer at {rate} baud; find the servo with: "
                + port.servo_command(f"scan --bauds {session.baud_rate} {rate}")
            )
        run(Servo(port, new_id, servo.model).lock_eeprom(True))


def _set_return_level(session: Session, servo: Servo, register: Register, value: int) -> None:
    """Set the Status Return Level, also of a servo that answers pings only."""
    what = f"{register.name} = {value}"
    _ask(session, servo, what + (", and relax it" if register.eeprom else ""))
    servo.acknowledges_writes = False  # the new level decides whether this write is answered
    table = servo.model.control_table
    lock = "EEPROM Lock" if "EEPROM Lock" in table else ""
    if register.eeprom:
        servo.write(table.block("Torque Enable"), 0)
    if lock:
        servo.write(table.block(lock), 0)
    servo.write(table.block(register.name), value)
    session.pause(EEPROM_PAUSE)
    if lock:
        servo.write(table.block(lock), 1)
    if value == 0:
        session.terminal.print(
            f"servo {servo.id} answers pings only from now on; give this tool --model "
            f"{servo.model.name}"
        )
    elif (after := servo.get(register.name)) != value:
        raise ToolError(f"servo {servo.id} still has {after} in {register.name}")


def _ask(session: Session, servo: Servo, what: str) -> None:
    session.terminal.confirm(f"Set {what} in servo {servo.id} ({servo.model.name})?")


def _check_goal(session: Session, servo: Servo, name: str, value: int) -> None:
    """Refuse goals outside the limits, and goals of a relaxed servo: some switch torque on."""
    if not servo.get("Torque Enable"):
        raise RefusedError(
            f"servo {servo.id} is relaxed; switch its torque on first: "
            + servo.set_command("Torque Enable", 1)
        )
    if name != "Goal Position":
        return
    low, high = _range(servo)
    if not low <= value <= high:
        raise RefusedError(
            f"goal {value} is outside the limits of servo {servo.id}, {low} to {high} "
            f"({' and '.join(servo.model.position_limits)})"
        )
    speed = servo.model.goal_speed
    if servo.get(speed) == 0:
        session.terminal.confirm(
            f"The {speed} of servo {servo.id} is 0: it moves at full speed. Continue?"
        )


def _switch_torque_on(session: Session, servo: Servo) -> None:
    """Switch torque on with the present position as the goal."""
    low, high = _range(servo)
    position = servo.get("Present Position")
    try:
        require_straight_path(servo, position, servo.range)
    except ServoError as refusal:
        raise RefusedError(f"{refusal}, or cycle its power") from refusal
    if not low <= position <= high:
        session.terminal.confirm(
            f"Servo {servo.id} is at {position}, outside its limits, {low} to {high}: with torque "
            f"on it moves slowly to {max(low, min(high, position))}. Switch it on?"
        )
    goal = run(pin(servo))
    session.terminal.print(f"goal {goal}, lowest speed")


def _range(servo: Servo) -> tuple[int, int]:
    """Return the limits of a servo in position mode; refuse other modes."""
    try:
        run(servo.identify(keep_torque=True))
    except ServoError as refusal:
        raise RefusedError(str(refusal)) from refusal
    return servo.range


def relax(session: Session, ids: Sequence[int]) -> None:
    """Switch torque off and read it back; without ids: of all servos.

    Raises:
        ToolError: none answers, or some did not confirm; the others are relaxed.
    """
    problems: list[str] = []
    with session.port() as port:
        found = ids or _relax_all(port, session.model)
        if not found:
            raise none_answers(port)
        for servo_id in found:
            try:
                find_servo(port, servo_id, session.model).set("Torque Enable", 0)
            except (ToolError, CommunicationError, ServoError) as problem:
                problems.append(str(problem))
            else:
                session.terminal.show(f"servo {servo_id} is relaxed")
    if not ids:
        session.terminal.show("torque off was sent to all servos")
    if problems:
        raise ToolError("; ".join(problems))


def _relax_all(port: DynamixelPort, model: ServoModel | None) -> list[int]:
    """Switch torque off by broadcast; return the ids that were found.

    Protocol 2.0: address 64 is Torque Enable of X servos and unused in an XL-320. Address 24 is
    Torque Enable of an XL-320, but Moving Threshold of X servos. Protocol 1.0: address 40 is Torque
    Enable of Feetech servos, and read-only in Dynamixel ones. Address 24 is Torque Enable of
    Dynamixel servos, but start torque of Feetech ones.
    """
    ax_address, feetech_address, x_address = (
        servo_model(name).control_table["Torque Enable"].address
        for name in ("AX-12", "STS3215", "XM430-W350")
    )

    def send(address: int, protocol: int) -> None:
        for _ in range(_BROADCASTS):
            port.write(BROADCAST_ID, address, b"\0", acknowledged=False, protocol=protocol)

    send(feetech_address, 1)
    send(x_address, 2)
    found = set()
    for servo_id in first_ids(port):
        found.add(servo_id)
        if model is None:
            with suppress(ToolError, CommunicationError):
                model = find_servo(port, servo_id).model
                if model.family == "Dynamixel":
                    send(ax_address, 1)  # before the others are asked
    if model is None or model.family == "Dynamixel":
        send(ax_address, 1)
    return sorted(found | port.find_all().keys())
