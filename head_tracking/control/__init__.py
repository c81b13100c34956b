"""Who commands which joint, and the loop in which it is done: read, update, write."""

from head_tracking.control.loop import Controller, ControlLoop
from head_tracking.control.owners import LEASE, JointOwners, OwnershipError

__all__ = ["LEASE", "ControlLoop", "Controller", "JointOwners", "OwnershipError"]
