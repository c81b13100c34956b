"""servo set, set-id, set-baud, relax: changes, and what they refuse."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Final

from head_tracking.cli.servo.bench import (
    ToolError,
    Workshop,
    find_servo,
    model_number,
    protocol_of,
)
from head_tracking.cli.servo.register_values import (
    UNLIMITED,
    asks_for_full_speed,
    find_register,
    in_words,
    parse_value,
)
from head_tracking.dynamixel.control_table import Register
from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ConfigurationError,
    CorruptReplyError,
    PositionError,
    ReplyTimeoutError,
    ServoError,
    ServoSetupError,
)
from head_tracking.dynamixel.models import ServoModel, servo_model, servo_model_by_number
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.protocol import BROADCAST_ID
from head_tracking.dynamixel.servo import EEPROM_PAUSE, Servo, run
from head_tracking.dynamixel.torque import pin, require_straight_path
from head_tracking.exceptions import RefusedError

_GOALS: Final = ("Goal Position", "Moving Speed", "Goal Velocity", "Goal PWM", "Goal Current")


def set_register(
    workshop: Workshop, servo_id: int, name: str, text: str, model: ServoModel | None
) -> int:
    """Write a register of a servo and return the exit code."""
    with workshop.port() as port:
        link = find_servo(port, servo_id, model)
        register = find_register(link.model.control_table, name)
        value = parse_value(register, text)
        name = register.name
        if name == "ID" and value != servo_id and (taken := protocol_of(port, value)) is not None:
            raise RefusedError(
                f"id {value} is taken by another servo (protocol {taken}.0); two servos with one "
                "id answer at the same time. Choose another id, or disconnect that servo"
            )
        if register.eeprom and name != "Status Return Level":
            _check_memory(link)
        shown = f"{name} = {value} {in_words(link.model, register, value)}".strip()
        if name not in ("ID", "Baud Rate"):
            _write(workshop, link, register, value, text, shown)
    if name in ("ID", "Baud Rate"):
        _move(workshop, link, name, value, shown)
    workshop.terminal.show(f"servo {servo_id}: {shown}")
    return 0


def set_baud_rate(workshop: Workshop, servo_id: int, rate: int, model: ServoModel | None) -> int:
    """Give a servo another baud rate and return the exit code."""
    with workshop.port() as port:
        rates = find_servo(port, servo_id, model).model.baud_rates
    codes = [code for code, known in rates.items() if known == rate]
    if not codes:
        known = ", ".join(map(str, sorted(rates.values())))
        raise ToolError(f"servo {servo_id} has no baud rate {rate}; it has {known}")
    return set_register(workshop, servo_id, "Baud Rate", str(codes[0]), model)


def _write(
    workshop: Workshop, link: Servo, register: Register, value: int, text: str, shown: str
) -> None:
    name = register.name
    if name == "Status Return Level":
        _set_return_level(workshop, link, register, value)
    elif register.eeprom:
        _ask(workshop, link, f"{shown} (now {link.get(name)})")
        run(link.write_eeprom({name: value}), workshop.pause)
    elif name == "Torque Enable" and value:
        _hold(workshop, link)
    else:
        if name == "Lock":
            _ask(workshop, link, shown)
        if name in UNLIMITED and not value and not asks_for_full_speed(text):
            raise RefusedError(
                f"{name} 0 is not a stop but full speed; the slowest is 1, "
                f"{in_words(link.model, register, 1)}. For full speed: servo set {link.id} "
                f"'{name}' full"
            )
        if name in _GOALS:
            _check_goal(workshop, link, name, value)
        link.set(name, value)


def _move(workshop: Workshop, link: Servo, name: str, value: int, shown: str) -> None:
    """Change how a servo is reached, and make sure that it is."""
    new_id = value if name == "ID" else link.id
    rates = link.model.baud_rates
    rate = rates.get(value) if name == "Baud Rate" else workshop.baud_rate
    if rate is None:
        known = ", ".join(f"{code} ({rate})" for code, rate in sorted(rates.items()))
        raise ToolError(f"{value} is not a baud rate of the {link.model.name}; it has {known}")
    with workshop.port(rate):
        pass  # the adapter can do it
    _ask(workshop, link, shown)
    with workshop.port() as port:
        link = find_servo(port, link.id, link.model)
        run(link.lock_eeprom(False))
        link.write(link.model.control_table.block(name), value)
        workshop.pause(EEPROM_PAUSE)
    with workshop.port(rate) as port:
        if protocol_of(port, new_id) is not None:
            run(Servo(port, new_id, link.model).lock_eeprom(True))
        else:
            raise ToolError(
                f"the servo does not answer as id {new_id} at {rate} baud; look for it: servo scan "
                f"--bauds {workshop.baud_rate} {rate}"
            )


def _set_return_level(workshop: Workshop, link: Servo, register: Register, value: int) -> None:
    """Set what a servo answers; it may be one that answers nothing but pings."""
    kept = register.eeprom
    _ask(workshop, link, f"{register.name} = {value}" + (", and relax it" if kept else ""))
    link.acknowledges_writes = False  # the answer, if any, is by the new level
    if kept:
        link.write(link.model.control_table.block("Torque Enable"), 0)
    table = link.model.control_table
    if "EEPROM Lock" in table:
        link.write(table.block("EEPROM Lock"), 0)
    link.write(table.block(register.name), value)
    workshop.pause(EEPROM_PAUSE)
    if "EEPROM Lock" in table:
        link.write(table.block("EEPROM Lock"), 1)
    if value == 0:
        workshop.terminal.say(
            f"servo {link.id} answers nothing but pings from now on; this tool needs --model "
            f"{link.model.name} then"
        )
    elif (after := link.get(register.name)) != value:
        raise ToolError(f"servo {link.id} keeps {after} in {register.name}")


def _ask(workshop: Workshop, link: Servo, what: str) -> None:
    workshop.terminal.confirm(f"Set {what} in servo {link.id} ({link.model.name})?")


def _check_memory(link: Servo) -> None:
    if link.get("Torque Enable"):
        raise RefusedError(
            f"the torque of servo {link.id} is on, and its memory must not be changed then; hold "
            f"what it carries, and relax it first: servo relax {link.id}"
        )
    if "Lock" in link.model.control_table and link.get("Lock"):
        raise RefusedError(f"the memory of servo {link.id} is locked; switch its power off and on")


def _check_goal(workshop: Workshop, link: Servo, name: str, value: int) -> None:
    """Refuse goals of a relaxed servo, which may switch its torque on, and those out of range."""
    if not link.get("Torque Enable"):
        raise RefusedError(
            f"servo {link.id} is relaxed; switch its torque on before it gets a goal: servo set "
            f"{link.id} 'Torque Enable' 1"
        )
    if name != "Goal Position":
        return
    low, high = _range(link)
    if not low <= value <= high:
        raise RefusedError(
            f"goal {value} is outside the limits of servo {link.id}, {low} to {high} "
            f"({' and '.join(link.model.position_limits)})"
        )
    speed = link.model.goal.registers[link.model.goal_order[1]].name
    if link.get(speed) == 0:
        workshop.terminal.confirm(
            f"The {speed} of servo {link.id} is 0: it goes there at full speed. Go on?"
        )


def _hold(workshop: Workshop, link: Servo) -> None:
    """Switch torque on where the servo stands, not on the way to an old goal."""
    low, high = _range(link)
    position = link.get("Present Position")
    try:
        require_straight_path(link, position)
    except PositionError as refusal:
        raise RefusedError(f"{refusal}, or cycle its power") from refusal
    if not low <= position <= high:
        workshop.terminal.confirm(
            f"Servo {link.id} is at {position}, outside its limits, {low} to {high}: with torque "
            f"on it creeps to {max(low, min(high, position))}. Switch it on?"
        )
    goal = run(pin(link))
    workshop.terminal.say(f"its goal is {goal}, its speed the lowest")


def _range(link: Servo) -> tuple[int, int]:
    """Return the limits of a servo that goes to positions; refuse others."""
    try:
        run(link.identify(keep_torque=True))
    except ServoSetupError as refusal:
        raise RefusedError(str(refusal)) from refusal
    return link.range


def relax(workshop: Workshop, ids: Sequence[int], model: ServoModel | None) -> int:
    """Switch torque off, of all servos if no id is given, and return the exit code."""
    with workshop.port() as port:
        if not ids:
            _relax_all(port, model)
            workshop.terminal.show("torque off was sent to all servos")
        for servo_id in ids:
            find_servo(port, servo_id, model).set_torque(False)
            workshop.terminal.show(f"servo {servo_id} is relaxed")
    return 0


def _is_feetech_line(port: DynamixelPort, model: ServoModel | None) -> bool:
    """Return whether the servo with the lowest id up to 20 is one of Feetech's."""
    if model is not None:
        return model.family != "Dynamixel"
    for servo_id in range(21):
        with suppress(ReplyTimeoutError):
            try:
                number = model_number(port, servo_id, 1)
                return servo_model_by_number(number).family != "Dynamixel"
            except (CorruptReplyError, ConfigurationError):
                return False
    return False


def _relax_all(port: DynamixelPort, model: ServoModel | None) -> None:
    """Switch torque off by broadcast, and one by one where a broadcast would hit other registers.

    In protocol 2.0, Torque Enable of an XL-320 is at 24, where X servos have their Moving
    Threshold; an XL-320 has nothing at 64, where theirs is. In protocol 1.0, Torque Enable of
    Feetech servos is at 40, where those of Dynamixel take no writes; at 24, where theirs is,
    Feetech servos have their start torque.
    """
    ax_address, feetech_address, x_address = (
        servo_model(name).control_table["Torque Enable"].address
        for name in ("AX-12", "STS3215", "XM430-W350")
    )
    for protocol, address in ((1, feetech_address), (2, x_address)):
        port.write(BROADCAST_ID, address, b"\0", acknowledged=False, protocol=protocol)
    if not _is_feetech_line(port, model):
        port.write(BROADCAST_ID, ax_address, b"\0", acknowledged=False)
    for servo_id, (number, _) in port.find_all().items():
        with suppress(ConfigurationError, CommunicationError, ServoError):
            model = servo_model_by_number(number)
            if model.control_table["Torque Enable"].address != x_address:
                Servo(port, servo_id, model).set_torque(False)
