"""simulated_bus: simulated servos on a serial port that any program can open."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from random import Random

from head_tracking.command_line import (
    baud_rate,
    between,
    exit_code,
    named_id,
    read_by,
)
from head_tracking.dynamixel.exceptions import ConfigurationError
from head_tracking.dynamixel.models import ServoModel, servo_model
from head_tracking.ros.kit.stop_signal import StopSignal
from head_tracking.simulation import (
    Fault,
    Faults,
    SimulatedBus,
    SimulatedPort,
    SimulatedServo,
    SimulationError,
)

_PATIENCE = 3600.0  # s
_APART = 31  # ticks
_model = read_by(servo_model, ConfigurationError)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the name of the port and serve it until SIGINT or SIGTERM; return the exit code."""
    options = _parser().parse_args(arguments)
    with StopSignal() as stop:
        return exit_code("simulated_bus", lambda: _simulate(options, stop))


def _simulate(options: argparse.Namespace, stop: StopSignal) -> None:
    random = Random(options.seed)
    servos = options.servo or [_named_servo("AX-12:1"), _named_servo("AX-12:2")]
    kinds = [Fault[name.upper()] for name in options.kinds]
    faults = Faults(random, options.faults / 100.0, kinds)
    ids = [number for _, number in servos]
    simulated = [
        _servo(model, number, ids[:k].count(number), options, random)
        for k, (model, number) in enumerate(servos)
    ]
    with SimulatedPort(
        SimulatedBus(simulated, faults=faults, echo=options.echo),
        link=options.link,
        paced=options.paced,
        latency=options.latency * 1e-3,
        match_baud_rate=options.baud is not None,
        on_failure=stop.set,
    ) as port:
        rate = f"{options.baud} baud" if options.baud else "any baud rate"
        listed = ", ".join(f"{model.name} {number}" for model, number in servos)
        print(port.port_name, flush=True)
        print(f"servos: {listed}, at {rate}; Ctrl-C ends it", file=sys.stderr)
        while not stop.wait(_PATIENCE):
            pass
    overlaps = [f"{kind.value} {n}" for kind, n in port.overlaps.most_common()]
    struck = [f"{kind.name.lower()} {n}" for kind, n in faults.counts.most_common()]
    for title, counts in (("two senders at once", overlaps), ("faults", struck)):
        if counts:
            print(f"{title}: {', '.join(counts)}", file=sys.stderr)
    if port.failure is not None:
        raise SimulationError("the simulator itself failed; the port has vanished")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="simulated_bus",
        description="Simulates Dynamixel and Feetech servos; prints the port to open.",
    )
    add = parser.add_argument
    add(
        "--servo", type=_named_servo, action="append", metavar="MODEL:ID",
        help="a servo, such as XL430-W250:3; may be repeated (default: AX-12:1 and AX-12:2)",
    )  # fmt: skip
    add("--link", metavar="PATH", help="also make a link to the port here")
    add("--baud", type=baud_rate, metavar="RATE", help="of the servos (default: they accept any)")
    add("--paced", action="store_true", help="simulate the transmission time of bytes")
    add(
        "--latency", type=between(0.0, 255.0, "ms"), default=0.0, metavar="MS",
        help="latency timer of the adapter; the default of FTDI is 16",
    )  # fmt: skip
    add(
        "--return-delay", type=between(0, 508, "us", int), metavar="US",
        help="the servos' return delay (default: the factory's 500)",
    )  # fmt: skip
    add("--realistic", action="store_true", help="start delay, encoder noise, slow EEPROM")
    add("--echo", action="store_true", help="let the adapter echo what it sends")
    add(
        "--faults", type=between(0.0, 100.0, "percent"), default=0.0, metavar="PERCENT",
        help="share of transactions with a fault",
    )  # fmt: skip
    names = [kind.name.lower() for kind in Fault]
    add(
        "--kinds", type=str.lower, choices=names, nargs="+", default=names, metavar="KIND",
        help=f"kinds of faults (all): {', '.join(names)}",
    )  # fmt: skip
    add("--seed", type=int, default=1, metavar="N", help="of the random numbers (default: 1)")
    return parser


def _servo(
    model: ServoModel, number: int, twins: int, options: argparse.Namespace, random: Random
) -> SimulatedServo:
    """Return a servo; one of several with the same id is elsewhere: their answers differ."""
    servo = SimulatedServo(
        number,
        model,
        position=model.center + _APART * twins,
        start_delay=0.03 if options.realistic else 0.0,
        position_noise=0.3 if options.realistic else 0.0,
        eeprom_time=0.006 if options.realistic else 0.0,
        random=Random(random.random()),
    )
    if options.baud is not None:
        codes = {rate: code for code, rate in model.baud_rates.items()}
        if options.baud not in codes:
            rates = ", ".join(map(str, sorted(codes)))
            raise SimulationError(f"{model.name} has no baud rate {options.baud}; it has {rates}")
        servo.set_register("Baud Rate", codes[options.baud])
    if options.return_delay is not None:
        servo.set_register("Return Delay Time", options.return_delay // 2)
    return servo


def _named_servo(text: str) -> tuple[ServoModel, int]:
    name, number = named_id(text)
    return _model(name), number
