"""The kinematic tree of a robot, and its forward kinematics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from operator import itemgetter

from head_tracking.compatibility import StrEnum
from head_tracking.transforms.chain import Chain, Step, rotating, sliding
from head_tracking.transforms.exceptions import LookupException, RobotModelError
from head_tracking.transforms.transform import Rotation, Transform, Vector3


class JointType(StrEnum):
    """The joint types of URDF with at most one degree of freedom."""

    FIXED = "fixed"
    REVOLUTE = "revolute"
    CONTINUOUS = "continuous"
    PRISMATIC = "prismatic"


@dataclass(frozen=True, slots=True)
class JointLimits:
    """The limits of a joint; infinite where there are none.

    Attributes:
        lower: smallest position [rad or m].
        upper: largest position [rad or m].
        velocity: largest speed [rad/s or m/s].
    """

    lower: float = float("-inf")
    upper: float = float("inf")
    velocity: float = float("inf")

    def clamp(self, position: float) -> float:
        """Return the nearest position within the limits."""
        return min(max(position, self.lower), self.upper)

    def contains(self, position: float, tolerance: float = 0.0) -> bool:
        """Return whether a position is within the limits, with a tolerance."""
        return self.lower - tolerance <= position <= self.upper + tolerance

    def narrowed(self, lower: float, upper: float, joint: str) -> JointLimits:
        """Return the intersection with the limits `lower` and `upper` of a joint.

        Raises:
            RobotModelError: it is empty.
        """
        narrowed = JointLimits(max(self.lower, lower), min(self.upper, upper), self.velocity)
        if not narrowed.lower < narrowed.upper:
            raise RobotModelError(
                f"{joint!r} cannot turn within both {self.lower:.4g} to {self.upper:.4g} (model) "
                f"and {lower:.4g} to {upper:.4g} (servo and parameters); widen one of them"
            )
        return narrowed


@dataclass(frozen=True, slots=True)
class Mimic:
    """The rule of a mimic joint: position = multiplier * (position of `joint`) + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint between two links, as in URDF.

    Attributes:
        name: unique in its model.
        type: fixed, revolute, continuous or prismatic.
        parent: name of the parent link.
        child: name of the child link.
        origin: takes points from the joint frame (the child at position 0) into the parent.
        axis: unit vector in the joint frame.
        limits: of position and velocity.
        mimic: the rule if this is a mimic joint.
    """

    name: str
    type: JointType
    parent: str
    child: str
    origin: Transform
    axis: Vector3 = (1.0, 0.0, 0.0)
    limits: JointLimits = JointLimits()
    mimic: Mimic | None = None

    @property
    def moves(self) -> bool:
        """Whether the joint is not fixed."""
        return self.type is not JointType.FIXED

    def steps(self, leader: Mimic, *, back: bool = False) -> tuple[Step, ...]:
        """Return `T_parent_child` as steps of a chain.

        Args:
            leader: the measured joint, and the rule from its position to that of this joint.
            back: return `T_child_parent`.
        """
        if not self.moves:
            return (self.origin.inverse() if back else self.origin,)
        x, y, z = self.axis
        axis = (-x, -y, -z) if back else self.axis
        kind = sliding if self.type is JointType.PRISMATIC else rotating
        motion = kind(axis, leader.multiplier, leader.offset)
        return (motion, self.origin.inverse()) if back else (self.origin, motion)

    def transform(self, position: float) -> Transform:
        """Return `T_parent_child` at a position [rad or m]."""
        if not self.moves:
            return self.origin
        if self.type is JointType.PRISMATIC:
            x, y, z = self.axis
            slide = Transform((position * x, position * y, position * z), Rotation.identity())
            return self.origin @ slide
        turn = Rotation.from_axis_angle(self.axis, position)
        return self.origin @ Transform((0.0, 0.0, 0.0), turn)


@dataclass(frozen=True, slots=True)
class JointChain:
    """The transform from one link to another as a function of joint positions.

    Attributes:
        joints: names of the joints whose positions are the arguments, in order.
        chain: the transforms.
    """

    joints: tuple[str, ...]
    chain: Chain

    def transform(self, *positions: float) -> Transform:
        """Return `T_target_source` at these joint positions [rad or m]."""
        return self.chain.transform(positions)


class RobotModel:
    """A tree of links connected by joints.

    Args:
        name: the robot's name.
        links: names of all links.
        joints: the joints that connect them.
        urdf: the URDF document of the model.

    Raises:
        RobotModelError: the links and joints are not a tree, a name occurs twice, or the rule of a
            mimic joint is not valid.
    """

    def __init__(
        self, name: str, links: Iterable[str], joints: Iterable[Joint], urdf: str = ""
    ) -> None:
        self.name = name
        self.links = tuple(links)
        self.urdf = urdf
        joints = tuple(joints)
        _refuse_duplicates("link", self.links)
        _refuse_duplicates("joint", [joint.name for joint in joints])
        self.joints: Mapping[str, Joint] = {joint.name: joint for joint in joints}
        self._parent_joint = _parent_joints(self.links, joints)
        self.children_of_joints = frozenset(self._parent_joint)
        self.root = _root(self.links, joints, self._parent_joint)
        mimics = {joint.name: joint.mimic for joint in joints if joint.mimic is not None}
        self._leaders = resolved_leaders(self, mimics)
        self._chains: dict[tuple[str, str], JointChain] = {}

    def joint(self, name: str) -> Joint:
        """Return a joint by its name.

        Raises:
            RobotModelError: there is none.
        """
        try:
            return self.joints[name]
        except KeyError:
            moving = ", ".join(joint.name for joint in self.joints.values() if joint.moves)
            raise RobotModelError(
                f"the model {self.name!r} has no joint {name!r}; its moving joints are: "
                f"{moving or 'none'}"
            ) from None

    def parent_joint(self, link: str) -> Joint | None:
        """Return the joint above a link; None for the root.

        Raises:
            LookupException: the link is unknown.
        """
        if link not in self.links:
            raise LookupException(
                f"the model {self.name!r} has no link {link!r}; its links are: "
                + ", ".join(self.links)
            )
        return self._parent_joint.get(link)

    def joints_above(self, link: str) -> list[Joint]:
        """Return the joints from a link up to the root.

        Raises:
            LookupException: the link is unknown.
        """
        above = []
        joint = self.parent_joint(link)
        while joint is not None:
            above.append(joint)
            joint = self._parent_joint.get(joint.parent)
        return above

    def leader(self, joint: str) -> Mimic:
        """Return the rule from the measured joint to this one, through any chain of mimic joints.

        For an independent joint this is the joint itself with the multiplier 1.
        """
        return self._leaders.get(joint) or Mimic(joint)

    def prefixed(self, prefix: str) -> RobotModel:
        """Return the same robot with a prefix before the names of its links."""
        if not prefix:
            return self
        joints = [
            replace(joint, parent=prefix + joint.parent, child=prefix + joint.child)
            for joint in self.joints.values()
        ]
        return RobotModel(self.name, [prefix + link for link in self.links], joints, self.urdf)

    @property
    def independent_joints(self) -> tuple[str, ...]:
        """Names of the joints that are neither fixed nor mimic joints, in order of the model."""
        return tuple(
            joint.name for joint in self.joints.values() if joint.moves and joint.mimic is None
        )

    def chain(self, target_link: str, source_link: str) -> JointChain:
        """Return the chain from source to target; it is made once for each pair of links.

        Raises:
            LookupException: a link is unknown.
        """
        chain = self._chains.get((target_link, source_link))
        if chain is None:
            target, source = self.joints_above(target_link), self.joints_above(source_link)
            while target and source and target[-1] is source[-1]:
                target.pop()
                source.pop()
            chain = self._chains[target_link, source_link] = self._join(target, source)
        return chain

    def transform(
        self, target_link: str, source_link: str, positions: Mapping[str, float]
    ) -> Transform:
        """Return `T_target_source` at these joint positions [rad or m].

        Raises:
            LookupException: a link is unknown, or a joint on the path has no position.
        """
        chain = self.chain(target_link, source_link)
        try:
            return chain.transform(*[positions[joint] for joint in chain.joints])
        except KeyError as error:
            raise LookupException(f"no position is given for the joint {error}") from None

    def _join(self, target: list[Joint], source: list[Joint]) -> JointChain:
        moving = [joint for joint in (*source, *reversed(target)) if joint.moves]
        leaders = [self.leader(joint.name).joint for joint in moving]
        joints = tuple(name for name in self.joints if name in leaders)
        steps: list[Step] = []
        for joint in target:
            steps += joint.steps(self.leader(joint.name), back=True)
        for joint in reversed(source):
            steps += joint.steps(self.leader(joint.name))
        readers = [itemgetter(joints.index(leader)) for leader in leaders]
        return JointChain(joints, Chain(steps, readers))


def resolved_leaders(model: RobotModel, mimics: Mapping[str, Mimic]) -> dict[str, Mimic]:
    """Return for each mimic joint the rule from an independent joint.

    Args:
        model: the robot.
        mimics: the direct rules.

    Raises:
        RobotModelError: a joint does not exist or is fixed, or rules form a loop.
    """
    return {name: _resolve(model.joints, name, mimics) for name in mimics}


def _resolve(joints: Mapping[str, Joint], name: str, mimics: Mapping[str, Mimic]) -> Mimic:
    multiplier, offset, chain = 1.0, 0.0, [name]
    while name in mimics:
        mimic = mimics[name]
        leader = joints.get(mimic.joint)
        if leader is None or not leader.moves:
            what = "is not in the model" if leader is None else "is fixed"
            raise RobotModelError(
                f"joint {name!r} mimics {mimic.joint!r}, which {what}; name a joint that moves"
            )
        offset += multiplier * mimic.offset
        multiplier *= mimic.multiplier
        name = leader.name
        if name in chain:
            raise RobotModelError("mimic joints form a loop: " + " -> ".join([*chain, name]))
        chain.append(name)
    return Mimic(name, multiplier, offset)


def _refuse_duplicates(kind: str, names: Iterable[str]) -> None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise RobotModelError(f"there are two {kind}s named {name!r}; rename one of them")
        seen.add(name)


def _parent_joints(links: tuple[str, ...], joints: tuple[Joint, ...]) -> dict[str, Joint]:
    known = set(links)
    parents: dict[str, Joint] = {}
    for joint in joints:
        for role, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in known:
                raise RobotModelError(
                    f"joint {joint.name!r} names the {role} link {link!r}, which is not in the "
                    f"model; its links are: {', '.join(links)}"
                )
        if joint.child in parents:
            raise RobotModelError(
                f"link {joint.child!r} is the child of two joints, "
                f"{parents[joint.child].name!r} and {joint.name!r}; a link has one parent"
            )
        parents[joint.child] = joint
    return parents


def _root(links: tuple[str, ...], joints: tuple[Joint, ...], parents: dict[str, Joint]) -> str:
    roots = [link for link in links if link not in parents]
    if len(roots) > 1:
        raise RobotModelError(
            f"the model has {len(roots)} root links ({', '.join(roots)}); "
            "connect them with joints so that one is left"
        )
    # each link but one has a parent: links that the root does not reach form a loop
    children: dict[str, list[str]] = {}
    for joint in joints:
        children.setdefault(joint.parent, []).append(joint.child)
    reached, waiting = set[str](), roots[:]
    while waiting:
        reached.add(waiting[-1])
        waiting += children.get(waiting.pop(), ())
    if len(reached) < len(links):
        loop = ", ".join(link for link in links if link not in reached)
        raise RobotModelError(
            f"the links {loop} form a loop; each must lead to one root"
            if links
            else "the model has no links"
        )
    if not roots:
        raise RobotModelError("the model has no links")
    return roots[0]
