"""Random faults of a serial bus and its servos."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace
from enum import Enum
from random import Random
from typing import Final

from head_tracking.simulation.bus import Answer, SimulatedBus
from head_tracking.simulation.packets import Status, decode_status, encode_status
from head_tracking.simulation.servo import SimulatedServo


class Fault(Enum):
    """A kind of fault."""

    DROP = "an answer is lost"
    CORRUPT = "a byte of an answer is changed"
    TRUNCATE = "the end of an answer is lost"
    DELAY = "the adapter hands an answer on late, after others"
    STALL = "a servo answers late, while others may talk"
    DUPLICATE = "an answer comes twice"
    FOREIGN = "the answer of another servo comes before"
    GARBAGE = "noise comes before an answer"
    ECHO = "what was sent comes back"
    DEAFNESS = "what was sent is lost"
    MISHEARING = "a byte of what was sent is changed"
    POWER_LOSS = "a servo loses its supply for a while"
    LOW_VOLTAGE = "a servo's supply is low for a while"
    OVERLOAD = "a servo finds its load too high"
    OVERHEATING = "a servo is too hot for a while"


LINE_FAULTS: Final = (
    Fault.DROP, Fault.CORRUPT, Fault.TRUNCATE, Fault.DELAY, Fault.STALL, Fault.DUPLICATE,
    Fault.FOREIGN, Fault.GARBAGE,
)  # fmt: skip
"""Faults of status packets."""

SERVO_FAULTS: Final = (Fault.POWER_LOSS, Fault.LOW_VOLTAGE, Fault.OVERLOAD, Fault.OVERHEATING)
"""Faults of servos."""


class Faults:
    """Injects faults at random: `SimulatedBus(servos, faults=Faults(Random(1), 0.05))`.

    Args:
        random: Source of random numbers.
        rate: Probability of a fault for each request and for each answer.
        kinds: The faults to inject.
        late: Minimum and maximum delay of DELAY and STALL, s.
        pause: Minimum and maximum duration of a fault of a servo, s.

    Attributes:
        rate: May be changed at any time.
        counts: Number of injected faults by kind.
        last: Time of the last fault, or of the end of a fault of a servo, ns.
    """

    def __init__(
        self,
        random: Random,
        rate: float,
        kinds: Iterable[Fault] = tuple(Fault),
        *,
        late: tuple[float, float] = (0.01, 0.1),
        pause: tuple[float, float] = (0.1, 2.0),
    ) -> None:
        self.rate = rate
        self.counts: Counter[Fault] = Counter()
        self.last = 0
        self._random = random
        kinds = tuple(kinds)
        self._answer_kinds = [kind for kind in kinds if kind in LINE_FAULTS]
        self._request_kinds = [kind for kind in kinds if kind not in LINE_FAULTS]
        self._late, self._pause = late, pause
        self._repairs: list[tuple[int, SimulatedServo, Callable[[], None]]] = []
        self._now = 0

    @property
    def trouble(self) -> bool:
        """Whether a fault of a servo is active."""
        return bool(self._repairs)

    def answer(self, answer: Answer) -> Iterable[Answer]:
        """Return what the master receives instead of an answer."""
        if not self._answer_kinds or self._random.random() >= self.rate:
            return (answer,)
        kind = self._random.choice(self._answer_kinds)
        self._note(kind)
        return self._spoil(answer, kind)

    def request(self, bus: SimulatedBus, data: bytes, now: int) -> tuple[bytes, list[Answer]]:
        """Return what the servos receive instead of a request, and immediate answers."""
        self._now = now
        self._repair(now)
        if not self._request_kinds or not data or self._random.random() >= self.rate:
            return data, []
        kind = self._random.choice(self._request_kinds)
        if kind in SERVO_FAULTS:
            self._strike(self._random.choice(tuple(bus)), kind, now)
            return data, []
        self._note(kind)
        if kind is Fault.ECHO:
            return data, [Answer(data, 0, echo=True)]
        return (b"" if kind is Fault.DEAFNESS else self._changed(data)), []

    def _note(self, kind: Fault) -> None:
        self.counts[kind] += 1
        self.last = max(self.last, self._now)

    def _spoil(self, answer: Answer, kind: Fault) -> tuple[Answer, ...]:
        data = answer.data
        match kind:
            case Fault.DROP:
                return ()
            case Fault.CORRUPT:
                data = self._changed(data)
            case Fault.TRUNCATE:
                data = data[: self._random.randrange(len(data))]
            case Fault.DELAY:
                return (replace(answer, late=self._time(self._late)),)
            case Fault.STALL:
                return (replace(answer, stalled=self._time(self._late)),)
            case Fault.DUPLICATE:
                data += data
            case Fault.FOREIGN:
                data = self._foreign(data) + data
            case _:
                data = self._random.randbytes(self._random.randrange(1, 12)) + data
        return (replace(answer, data=data),)

    def _changed(self, data: bytes) -> bytes:
        changed = bytearray(data)
        changed[self._random.randrange(len(data))] ^= self._random.randrange(1, 256)
        return bytes(changed)

    def _foreign(self, data: bytes) -> bytes:
        """Return a valid answer of another servo, of the same size."""
        for protocol in (2, 1):
            own = decode_status(protocol, data)
            if own is not None:
                noise = self._random.randbytes(len(own.data))
                return encode_status(protocol, Status((own.id + 1) % 252, 0, noise))
        return b""

    def _time(self, bounds: tuple[float, float]) -> int:
        return round(self._random.uniform(*bounds) * 1e9)

    def _strike(self, servo: SimulatedServo, kind: Fault, now: int) -> None:
        servo.advance(now)
        if kind is Fault.OVERLOAD:
            self._note(kind)
            servo.overload()
            return
        if any(affected is servo for _, affected, _ in self._repairs):
            return
        self._note(kind)
        end = now + self._time(self._pause)
        if kind is Fault.POWER_LOSS:
            servo.power_off()
            self._repairs.append((end, servo, servo.power_on))
        elif kind is Fault.LOW_VOLTAGE:
            usual = servo.supply_voltage
            servo.supply_voltage = servo.register("Min Voltage Limit") / 10.0 - 0.5
            self._repairs.append((end, servo, lambda: setattr(servo, "supply_voltage", usual)))
        else:
            before = servo.temperature
            servo.temperature = servo.register("Temperature Limit") + 5.0
            self._repairs.append((end, servo, lambda: setattr(servo, "temperature", before)))

    def _repair(self, now: int) -> None:
        for repair in [repair for repair in self._repairs if repair[0] <= now]:
            self._repairs.remove(repair)
            repair[1].advance(now)
            repair[2]()
            self.last = max(self.last, now)
