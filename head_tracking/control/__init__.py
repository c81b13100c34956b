"""Who commands which joint, and the loop in which it is done: read, update, write."""

from head_tracking.control.loop import Controller, ControlLoop
from head_tracking.control.owners import JUST_STOPPED, LEASE, JointOwners, OwnershipError

__all__ = ["JUST_STOPPED", "LEASE", "ControlLoop", "Controller", "JointOwners", "OwnershipError"]
