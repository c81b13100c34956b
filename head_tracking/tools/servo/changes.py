"""servo set, set-id, set-baud, relax: changes, and what keeps them from doing harm."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Final

from head_tracking.dynamixel.control_table import Register
from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ConfigurationError,
    DynamixelError,
    PositionError,
    ServoError,
)
from head_tracking.dynamixel.models import ServoModel, servo_model, servo_model_by_number
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.protocol import BROADCAST_ID
from head_tracking.dynamixel.servo import EEPROM_PAUSE, Servo, run
from head_tracking.tools.servo.bench import (
    RefusedError,
    ToolError,
    Workshop,
    find_servo,
    protocol_of,
)
from head_tracking.tools.servo.registers import (
    UNLIMITED,
    asks_for_full_speed,
    find_register,
    in_words,
    parse_value,
)

_STIFFENING: Final = ("Goal Position", "Moving Speed", "Goal Velocity", "Goal PWM", "Goal Current")
_TORQUE_BY_GOAL: Final = 8  # bit of Drive Mode


def set_register(
    workshop: Workshop, servo_id: int, name: str, text: str, model: ServoModel | None
) -> int:
    """Write a register of a servo and return the exit code."""
    with workshop.port() as port:
        link = find_servo(port, servo_id, model)
        register = find_register(link.model.control_table, name)
        value = parse_value(register, text)
        if register.name not in ("ID", "Baud Rate"):
            _check_speed(link, register, value, text)
            _set(workshop, link, register, value)
            return 0
    if register.name == "ID":
        return set_id(workshop, servo_id, value, model)
    return set_baud_rate(workshop, servo_id, link.model.baud_rates.get(value, 0), model)


def _set(workshop: Workshop, link: Servo, register: Register, value: int) -> None:
    terminal = workshop.terminal
    stop = register.name == "Moving Speed" and not value and _is_wheel(link)
    told = f"{value} {'' if stop else in_words(link.model, register, value)}".strip()
    if register.name == "Status Return Level":
        _set_return_level(workshop, link, value)
    elif register.eeprom or register.name == "Lock":
        before = link.get(register.name)
        _check_torque(link)
        _ask(workshop, link, f"{register.name} = {told} (now {before})")
        if register.eeprom:
            run(link.write_eeprom({register.name: value}), workshop.pause)
        else:
            link.set(register.name, value)
    elif register.name == "Torque Enable" and value:
        _hold(workshop, link)
    else:
        _check_goal(workshop, link, register, value)
        link.set(register.name, value)
    terminal.show(f"servo {link.id}: {register.name} = {told}")


def _set_return_level(workshop: Workshop, link: Servo, value: int) -> None:
    """Set what a servo answers; it may be one that answers nothing but pings."""
    register = link.model.control_table["Status Return Level"]
    kept = register.eeprom
    _ask(workshop, link, f"{register.name} = {value}" + (", and relax it" if kept else ""))
    if kept:
        link.release()
    link.acknowledges_writes = False  # the answer, if any, is by the new level
    link.write(link.model.control_table.block(register.name), value)
    workshop.pause(EEPROM_PAUSE)
    if value == 0:
        workshop.terminal.say(
            f"servo {link.id} answers nothing but pings from now on; this tool needs --model "
            f"{link.model.name} then"
        )
        return
    after = link.get(register.name)
    if after != value:
        raise ToolError(f"servo {link.id} keeps {after} in {register.name}")


def _ask(workshop: Workshop, link: Servo, what: str) -> None:
    workshop.terminal.confirm(f"Set {what} in servo {link.id} ({link.model.name})?")


def set_id(workshop: Workshop, servo_id: int, new_id: int, model: ServoModel | None) -> int:
    """Give a servo another id and return the exit code."""
    with workshop.port() as port:
        link = find_servo(port, servo_id, model)
        register = link.model.control_table["ID"]
        if not register.admits(new_id):
            raise ToolError(
                f"ids of the {link.model.name} are {register.minimum} to "
                f"{register.maximum}, not {new_id}"
            )
        if new_id == servo_id:
            workshop.terminal.show(f"servo {servo_id} has that id already")
            return 0
        taken = protocol_of(port, new_id)
        if taken is not None:
            raise RefusedError(
                f"id {new_id} is taken by another servo (protocol {taken}.0); two servos with one "
                "id talk at the same time. Choose another id, or disconnect that servo"
            )
        _check_memory(link)
        workshop.terminal.confirm(f"Give servo {servo_id} ({link.model.name}) the id {new_id}?")
        link.write(link.model.control_table.block("ID"), new_id)
        workshop.pause(EEPROM_PAUSE)
        if protocol_of(port, new_id) is None:
            raise ToolError(f"the servo does not answer with id {new_id}; look for it: servo scan")
    workshop.terminal.show(f"servo {servo_id} has the id {new_id} now")
    return 0


def set_baud_rate(workshop: Workshop, servo_id: int, rate: int, model: ServoModel | None) -> int:
    """Give a servo another baud rate and return the exit code."""
    with workshop.port() as port:
        link = find_servo(port, servo_id, model)
        codes = {speed: code for code, speed in link.model.baud_rates.items()}
        if rate not in codes:
            raise ToolError(
                f"the {link.model.name} has no baud rate {rate}; it has "
                f"{', '.join(map(str, sorted(codes)))}"
            )
        if rate == workshop.baud_rate:
            workshop.terminal.show(f"servo {servo_id} has that baud rate already")
            return 0
        _check_memory(link)
    with workshop.port(rate):
        pass  # the adapter can do it
    workshop.terminal.confirm(f"Set servo {servo_id} ({link.model.name}) to {rate} baud?")
    with workshop.port() as port:
        link = find_servo(port, servo_id, model)
        link.write(link.model.control_table.block("Baud Rate"), codes[rate])
        workshop.pause(EEPROM_PAUSE)
    with workshop.port(rate) as port:
        if protocol_of(port, servo_id) is None:
            raise ToolError(
                f"servo {servo_id} does not answer at {rate} baud; look for it: servo scan "
                f"--bauds {workshop.baud_rate} {rate}"
            )
    workshop.terminal.show(f"servo {servo_id} talks at {rate} baud now: use --baud {rate}")
    return 0


def relax(workshop: Workshop, ids: Sequence[int], model: ServoModel | None) -> int:
    """Switch torque off, of all servos if no id is given, and return the exit code."""
    with workshop.port() as port:
        if not ids:
            _relax_all(port)
            workshop.terminal.show("all servos were told to relax")
            return 0
        for servo_id in ids:
            find_servo(port, servo_id, model).set_torque(False)
            workshop.terminal.show(f"servo {servo_id} is relaxed")
    return 0


def _relax_all(port: DynamixelPort) -> None:
    """Switch torque off by broadcast, and one by one where a broadcast would hit other registers.

    In protocol 2.0, Torque Enable of an XL-320 is at 24, where X servos have their Moving
    Threshold; an XL-320 has nothing at 64, where theirs is.
    """
    ax_address, x_address = (
        servo_model(name).control_table["Torque Enable"].address for name in ("AX-12", "XM430-W350")
    )
    for protocol, address in ((1, ax_address), (2, x_address)):
        port.write(BROADCAST_ID, address, b"\0", acknowledged=False, protocol=protocol)
    for servo_id, (number, _) in port.find_all().items():
        with suppress(ConfigurationError, CommunicationError, ServoError):
            model = servo_model_by_number(number)
            if model.control_table["Torque Enable"].address != x_address:
                Servo(port, servo_id, model).set_torque(False)


def _check_torque(link: Servo) -> None:
    if link.get("Torque Enable"):
        raise RefusedError(
            f"the torque of servo {link.id} is on, and its memory must not be changed then; hold "
            f"what it carries, and relax it first: servo relax {link.id}"
        )


def _check_memory(link: Servo) -> None:
    _check_torque(link)
    if "Lock" in link.model.control_table and link.get("Lock"):
        raise RefusedError(f"the memory of servo {link.id} is locked; switch its power off and on")


def _check_speed(link: Servo, register: Register, value: int, text: str) -> None:
    """Refuse a speed of 0 that is full speed, unless it is called so."""
    if register.name not in UNLIMITED or value:
        return
    full, asked = register.name == "Profile Velocity" or not _is_wheel(link), text.strip()
    if full and not asks_for_full_speed(text):
        lowest = in_words(link.model, register, 1)
        counts = "" if asked.lstrip("+-") == "0" else f" ({asked})"
        raise RefusedError(
            f"{register.name} 0{counts} is not a stop but full speed; the slowest is 1, {lowest}. "
            f"If full speed is wanted: servo set {link.id} '{register.name}' full"
        )
    if not full and asks_for_full_speed(text):
        raise RefusedError(f"servo {link.id} is in wheel mode, where 0 is a stop, not full speed")


def _check_goal(workshop: Workshop, link: Servo, register: Register, value: int) -> None:
    """Refuse goals beyond the servo's own limits, and those that switch torque on."""
    if register.name not in _STIFFENING:
        return
    relaxed = not link.get("Torque Enable")
    if relaxed and _stiffens(link):
        raise RefusedError(
            f"servo {link.id} is relaxed, and this would switch its torque on while it is on the "
            f"way to a goal; switch it on first: servo set {link.id} 'Torque Enable' 1"
        )
    if register.name != "Goal Position" or not _goes_to_positions(link):
        return
    low, high = (link.get(name) for name in link.model.position_limits)
    if not low <= value <= high:
        raise RefusedError(
            f"goal {value} is outside the limits of servo {link.id}, {low} to {high} "
            f"({' and '.join(link.model.position_limits)})"
        )
    speed = _speed_register(link)
    if not relaxed and link.get(speed) == 0:
        workshop.terminal.confirm(
            f"The {speed} of servo {link.id} is 0: it goes there at full speed. Go on?"
        )


def _speed_register(link: Servo) -> str:
    return link.model.goal.registers[1 if link.model.position_first else 0].name


def _stiffens(link: Servo) -> bool:
    """Return whether goals switch torque on: AX servos do so, others if they are told to."""
    if "Drive Mode" in link.model.control_table and link.model.protocol == 2:
        return bool(link.get("Drive Mode") & _TORQUE_BY_GOAL)
    return link.model.sign_magnitude


def _is_wheel(link: Servo) -> bool:
    """Return whether the servo turns without end, at a speed of which 0 is a stop."""
    table = link.model.control_table
    if "Operating Mode" in table:
        return False  # it has a Goal Velocity for that
    if "Control Mode" in table:
        return link.get("Control Mode") == 1
    return all(link.get(name) == 0 for name in link.model.position_limits)


def _goes_to_positions(link: Servo) -> bool:
    """Return whether the servo goes to positions within one turn."""
    if "Operating Mode" in link.model.control_table:
        return link.get("Operating Mode") == 3
    low, high = (link.get(name) for name in link.model.position_limits)
    return low != high and not _is_wheel(link)


def _hold(workshop: Workshop, link: Servo) -> None:
    """Switch torque on where the servo stands, not on the way to an old goal."""
    if not _goes_to_positions(link):
        raise RefusedError(
            f"servo {link.id} is in a mode in which it would start to turn; set its position mode "
            "first"
        )
    low, high = (link.get(name) for name in link.model.position_limits)
    link.range = (low, high)
    stands = link.get("Present Position")
    try:
        link.require_straight_path(stands)
    except PositionError as refusal:
        raise RefusedError(f"{refusal}, or cycle its power") from refusal
    outside = not low <= stands <= high
    if outside:
        workshop.terminal.confirm(
            f"Servo {link.id} stands at {stands}, outside its limits, {low} to {high}: with torque "
            f"on it creeps to {max(low, min(high, stands))}. Switch it on?"
        )
    try:
        goal = run(link.pin((low, high)))
    except DynamixelError as error:
        raise ToolError(f"servo {link.id} does not switch its torque on: {error}") from error
    speed = _speed_register(link)
    state = f"it creeps to {goal}" if outside else "it stands still"
    workshop.terminal.say(f"{state}; its {speed} is {link.get(speed)} now, its lowest")
