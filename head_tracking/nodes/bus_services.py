"""The services of the servo bus."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Any

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from head_tracking.dynamixel import (
    Buses,
    DynamixelError,
    EepromSettings,
    ServoBus,
    Torque,
)

_TIMEOUT = 2.0  # s
_RESTART = 3.0  # s that a servo may take to restart
_POLL = 0.02  # s

Joints = tuple[str, ...]
Request = Callable[[ServoBus, Joints], object]


class BusServices:
    """Offers torque, relaxing, recovery, stopping and starting, and the servos' memory.

    Args:
        node: offers the services.
        buses: carry them out.
        eeprom: what to write into the servos' memory when somebody asks for it.
    """

    def __init__(self, node: Node, buses: Buses, eeprom: Callable[[], EepromSettings]) -> None:
        self._buses = buses
        self._eeprom = eeprom
        everything = tuple(joint.joint_name for joint in buses.joints)
        for joint in buses.joints:
            one, controller = (joint.joint_name,), joint.controller
            node.create_service(SetBool, f"{controller}/torque_enable", self._on_torque(one))
            self._offer(node, f"{controller}/stop", partial(self._stop, one))
            self._offer(node, f"{controller}/start", partial(self._start, one))
            self._offer(node, f"{controller}/restart", partial(self._restart, one))
            self._offer(node, f"{controller}/recover", partial(self._recover, one))
        node.create_service(SetBool, "torque_enable", self._on_torque(everything))
        self._offer(node, "relax", lambda: self._switch(everything, False))
        self._offer(node, "recover", lambda: self._recover(everything))
        self._offer(node, "~/write_eeprom", lambda: self._write_eeprom(everything))

    def _offer(self, node: Node, name: str, act: Callable[[], str]) -> None:
        def callback(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            return _answer(response, act)

        node.create_service(Trigger, name, callback)

    def _on_torque(
        self, joints: Joints
    ) -> Callable[[SetBool.Request, SetBool.Response], SetBool.Response]:
        def callback(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
            return _answer(response, lambda: self._switch(joints, request.data))

        return callback

    def _switch(self, joints: Joints, on: bool) -> str:
        self._run(joints, lambda bus, share: bus.set_torque(share, on))
        return f"{', '.join(joints)}: {'torque on' if on else 'relaxed'}"

    def _stop(self, joints: Joints) -> str:
        self._run(joints, lambda bus, share: bus.stop(share))
        return f"{', '.join(joints)}: stopped"

    def _start(self, joints: Joints) -> str:
        self._run(joints, lambda bus, share: bus.start(share))
        return f"{', '.join(joints)}: started, relaxed until a command comes"

    def _restart(self, joints: Joints) -> str:
        self._stop(joints)
        return self._start(joints)

    def _recover(self, joints: Joints) -> str:
        found: list[tuple[str, ...]] = self._run(joints, lambda bus, share: bus.recover(share))
        faulted = [joint for share in found for joint in share]
        if not faulted:
            return "no servo has a fault"
        deadline = time.monotonic() + _RESTART
        while waiting := [j for j in faulted if self._buses.torque(j) is Torque.OFF_BY_FAULT]:
            if time.monotonic() > deadline:
                raise TimeoutError(f"{', '.join(waiting)}: does not recover; see /diagnostics")
            time.sleep(_POLL)
        return f"{', '.join(faulted)}: recovered, relaxed until a command comes"

    def _write_eeprom(self, joints: Joints) -> str:
        settings = self._eeprom()
        changes: list[str] = []
        for joint in joints:  # one at a time, so that the others are not kept waiting
            (found,) = self._run((joint,), lambda bus, share: bus.write_eeprom(share[0], settings))
            for servo_id, changed in found.items():
                changes += [
                    f"servo {servo_id}: {name} {old} -> {new}"
                    for name, (old, new) in changed.items()
                ]
        return "; ".join(changes) or "nothing to change"

    def _run(self, joints: Joints, request: Request) -> list[Any]:
        """What came of it on each bus; raises the first error after all have ended."""
        futures: list[Future[Any]] = self._buses.call(joints, request)
        errors = [error for error in (future.exception(_TIMEOUT) for future in futures) if error]
        if errors:
            raise errors[0]
        return [future.result() for future in futures]


def _answer(response: Any, act: Callable[[], str]) -> Any:
    try:
        response.message = act()
        response.success = True
    except DynamixelError as error:
        response.success, response.message = False, str(error)
    except TimeoutError as error:
        response.success = False
        response.message = str(error) or f"the bus did not answer within {_TIMEOUT} s"
    return response
