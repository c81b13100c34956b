"""Who commands which joint, STOP, and the loop in which joints are read, updated and written."""

from head_tracking.control.loop import Controller, ControlLoop, JointBackend
from head_tracking.control.owners import LEASE, STOPPED, JointOwners, OwnershipError

__all__ = [
    "LEASE",
    "STOPPED",
    "ControlLoop",
    "Controller",
    "JointBackend",
    "JointOwners",
    "OwnershipError",
]
