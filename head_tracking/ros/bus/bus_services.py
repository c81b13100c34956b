"""The services of the servo bus.

No service delays another one, or a command: the thread of the bus executes each request in steps
between its cycles. Requests to relax are executed at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import Future, wait
from typing import Any

from rclpy.node import Node
from std_srvs.srv import SetBool

from head_tracking.control import ControlLoop
from head_tracking.control.dynamixel_backend import DynamixelBackend
from head_tracking.dynamixel import (
    EepromSettings,
    ServoBus,
    TorqueError,
)
from head_tracking.dynamixel.bus import RESTART_TIME
from head_tracking.ros.kit.joint_owners import offer_stop
from head_tracking.ros.kit.threads import UrgentServices

_TIMEOUT = 2.0  # s
_MEMORY = 10.0  # s

Joints = tuple[str, ...]
Request = Callable[[ServoBus, Joints], object]


class BusServices:
    """Offers the services for torque, recovery, stopping and starting, and the EEPROM.

    They run in threads of their own, see `UrgentServices`.

    Args:
        loop: has STOP; while the head is stopped, only requests to relax are executed.
        eeprom: returns the settings that `write_eeprom` writes.
        short_names: offer the services of the whole bus also without the node's name.
    """

    def __init__(
        self,
        bus: Node,
        servos: DynamixelBackend,
        loop: ControlLoop,
        eeprom: Callable[[], EepromSettings],
        *,
        short_names: bool,
    ) -> None:
        self._servos, self._loop, self._eeprom = servos, loop, eeprom
        everything = tuple(joint.joint_name for joint in servos.joints)
        self._services = UrgentServices(bus)
        self._offer = self._services.offer
        for joint in servos.joints:
            self._offer_for_joint(joint.controller, (joint.joint_name,))
        prefixes = ("~/", "") if short_names else ("~/",)
        for prefix in prefixes:
            self._offer_torque(f"{prefix}torque_enable", everything)
            self._offer(f"{prefix}relax", lambda _: self._relax(everything))
            self._offer(f"{prefix}recover", lambda _: self._recover(everything))
        self._offer("~/write_eeprom", lambda _: self._write_eeprom(everything))
        offer_stop(self._services, loop.stop, servos.resume, prefixes)
        self._services.start()

    def close(self) -> None:
        """Withdraw the services."""
        self._services.close()

    def _offer_for_joint(self, controller: str, joint: Joints) -> None:
        self._offer_torque(f"{controller}/torque_enable", joint)
        self._offer(f"{controller}/stop", lambda _: self._take_out(joint))
        self._offer(f"{controller}/start", lambda _: self._start(joint))
        self._offer(f"{controller}/restart", lambda _: self._restart(joint))
        self._offer(f"{controller}/recover", lambda _: self._recover(joint))

    def _offer_torque(self, name: str, joints: Joints) -> None:
        self._offer(name, lambda request: self._switch(joints, request.data), SetBool)

    def _relax(self, joints: Joints) -> str:
        if not self._loop.owners.stopped:
            return self._switch(joints, False)
        problems = {j: problem for j, problem in self._loop.stop().items() if problem}
        if problems:
            raise TorqueError(False, problems)
        return f"{', '.join(joints)}: relaxed"

    def _switch(self, joints: Joints, on: bool) -> str:
        self._run(joints, lambda bus, share: bus.switching_torque(share, on), despite_stop=not on)
        return f"{', '.join(joints)}: {'torque on' if on else 'relaxed'}"

    def _take_out(self, joints: Joints) -> str:
        self._run(joints, lambda bus, share: bus.stopping(share), despite_stop=True)
        return f"{', '.join(joints)}: stopped"

    def _start(self, joints: Joints) -> str:
        self._run(joints, lambda bus, share: bus.starting(share))
        return self._report(joints, "started")

    def _restart(self, joints: Joints) -> str:
        self._loop.owners.permit()
        self._take_out(joints)
        return self._start(joints)

    def _recover(self, joints: Joints) -> str:
        found = self._run(
            joints, lambda bus, share: bus.recovering(share, RESTART_TIME), RESTART_TIME + _TIMEOUT
        )
        faulted = [joint for share in found for joint in share]
        if not faulted:
            return "no servo has a fault"
        return self._report(faulted, "recovered")

    def _report(self, joints: Iterable[str], done: str) -> str:
        torque = [f"{joint} {done}: {self._servos.joint(joint).torque.value}" for joint in joints]
        return "\n".join(torque)

    def _write_eeprom(self, joints: Joints) -> str:
        settings = self._eeprom()
        changes: list[str] = []
        for joint in joints:
            self._loop.owners.permit()
            (found,) = self._run(
                (joint,),
                lambda bus, share: bus.writing_eeprom(share[0], settings),
                _MEMORY,
                despite_stop=True,  # the lock of a Feetech servo's memory must not stay off
            )
            for servo_id, changed in found.items():
                changes += [
                    f"servo {servo_id}: {name} {old} -> {new}"
                    for name, (old, new) in changed.items()
                ]
        return "; ".join(changes) or "nothing to change"

    def _run(
        self,
        joints: Joints,
        request: Request,
        timeout: float | None = None,
        *,
        despite_stop: bool = False,
    ) -> list[Any]:
        """Return the result of each bus; raise the first error after all have ended.

        A request `despite_stop` moves nothing, and is executed also after a STOP.

        Raises:
            StoppedError: the head is stopped, or was before the request was executed.
            TimeoutError: the time has passed. The request is cancelled, unless `despite_stop`.
        """
        timeout = timeout or _TIMEOUT
        epoch = None if despite_stop else self._loop.owners.permit()
        futures: list[Future[Any]] = self._servos.call(
            joints, request, epoch, despite_stop=despite_stop
        )
        late = list(wait(futures, timeout).not_done)
        if late and not despite_stop:
            late = [future for future in late if future.cancel()]
        if late:
            more = "it keeps trying" if despite_stop else "the request is cancelled"
            raise TimeoutError(f"the bus has not executed the request within {timeout} s; {more}")
        errors = [error for error in (future.exception() for future in futures) if error]
        if errors:
            raise errors[0]
        return [future.result() for future in futures]
