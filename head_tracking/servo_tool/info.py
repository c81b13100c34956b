"""servo info: all registers of a servo, by name and in units."""

from __future__ import annotations

from rich.table import Table

from head_tracking.dynamixel.models import ServoModel
from head_tracking.servo_tool.registers import in_words
from head_tracking.servo_tool.workshop import Workshop, find_servo


def info(workshop: Workshop, servo_id: int, model: ServoModel | None, *, all_of_them: bool) -> int:
    """Show the registers of a servo and return the exit code."""
    with workshop.port() as port:
        link = find_servo(port, servo_id, model)
        registers = link.registers()
    name = link.model.name
    workshop.terminal.show(f"servo {servo_id}: {name}, protocol {link.model.protocol}.0")
    table = Table("address", "register", "value", "meaning", "kept", "access", box=None)
    for register, value in registers:
        if register.name.startswith("Indirect") and not all_of_them:
            continue
        table.add_row(
            str(register.address),
            register.name,
            str(value),
            in_words(link.model, register, value),
            register.memory.value,
            register.access.value,
        )
    workshop.terminal.show(table)
    return 0
