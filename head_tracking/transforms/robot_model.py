"""The kinematic tree of a robot: links, joints, and where each link is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from head_tracking.transforms.exceptions import LookupException, RobotModelError
from head_tracking.transforms.joint import Joint, Mimic
from head_tracking.transforms.transform import Transform


class RobotModel:
    """A tree of links connected by joints.

    Args:
        name: the robot's name.
        links: names of all links.
        joints: the joints that connect them.
        urdf: the text that the model was read from, as other programs can read it.

    Raises:
        RobotModelError: a name twice, a joint to a link that is not there, a link with two
            parents, a loop, several roots, or a mimic joint that leads nowhere.
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
        self.root = _root(self.links, joints, self._parent_joint)
        self._leaders = {joint.name: self._resolve(joint) for joint in joints if joint.moves}
        self._children: dict[str, list[str]] = {link: [] for link in self.links}
        for joint in joints:
            self._children[joint.parent].append(joint.child)

    def joint(self, name: str) -> Joint:
        """The joint of this name.

        Raises:
            RobotModelError: there is none; the message lists those that move.
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
        """The joint that carries `link`; None for the root.

        Raises:
            LookupException: there is no such link.
        """
        if link not in self._children:
            raise LookupException(
                f"the model {self.name!r} has no link {link!r}; its links are: "
                + ", ".join(self.links)
            )
        return self._parent_joint.get(link)

    def children(self, link: str) -> tuple[str, ...]:
        """The links that `link` carries, in the order of the model."""
        return tuple(self._children[link])

    def joints_above(self, link: str) -> list[Joint]:
        """The joints from `link` up to the root, nearest first.

        Raises:
            LookupException: there is no such link.
        """
        above = []
        joint = self.parent_joint(link)
        while joint is not None:
            above.append(joint)
            joint = self._parent_joint.get(joint.parent)
        return above

    def leader(self, joint: str) -> Mimic:
        """The joint whose measurement decides `joint`, through any chain of mimic joints.

        For a joint that follows nobody this is itself, times 1 plus 0.
        """
        return self._leaders[joint]

    @property
    def independent_joints(self) -> tuple[str, ...]:
        """Names of the joints that move and follow no other, in the order of the model."""
        return tuple(
            joint.name for joint in self.joints.values() if joint.moves and joint.mimic is None
        )

    def joint_position(self, joint: Joint, positions: Mapping[str, float]) -> float:
        """The position of `joint`, given those of the independent joints; 0 if it can't move.

        Raises:
            LookupException: the joint that decides it is not among `positions`.
        """
        if not joint.moves:
            return 0.0
        leader = self._leaders[joint.name]
        try:
            return leader.multiplier * positions[leader.joint] + leader.offset
        except KeyError:
            raise LookupException(f"no position is given for the joint {leader.joint!r}") from None

    def transform(
        self, target_link: str, source_link: str, positions: Mapping[str, float]
    ) -> Transform:
        """Forward kinematics: `T_target_source` at these joint positions [rad or m].

        Raises:
            LookupException: an unknown link, or a joint on the way without a position.
        """
        target = self.joints_above(target_link)
        source = self.joints_above(source_link)
        while target and source and target[-1] is source[-1]:
            target.pop()
            source.pop()
        return self._product(target, positions).inverse() @ self._product(source, positions)

    def _product(self, joints_above: list[Joint], positions: Mapping[str, float]) -> Transform:
        product = Transform.identity()
        for joint in reversed(joints_above):
            product = product @ joint.transform(self.joint_position(joint, positions))
        return product

    def _resolve(self, joint: Joint) -> Mimic:
        multiplier, offset, chain = 1.0, 0.0, [joint.name]
        while joint.mimic is not None:
            leader = self.joints.get(joint.mimic.joint)
            if leader is None or not leader.moves:
                what = "is not in the model" if leader is None else "is fixed"
                raise RobotModelError(
                    f"joint {joint.name!r} mimics {joint.mimic.joint!r}, which {what}; "
                    "name a joint that moves"
                )
            offset += multiplier * joint.mimic.offset
            multiplier *= joint.mimic.multiplier
            if leader.name in chain:
                raise RobotModelError(
                    "mimic joints follow each other in a circle: "
                    + " -> ".join([*chain, leader.name])
                )
            chain.append(leader.name)
            joint = leader
        return Mimic(joint.name, multiplier, offset)


@dataclass(frozen=True, slots=True)
class TreeEntry:
    """One link of a tree on the way down from the root.

    Attributes:
        link: its name.
        depth: 0 for the root.
        rank: which child of its parent it is, from 1; 0 for the root.
        children: how many links it carries.
    """

    link: str
    depth: int
    rank: int
    children: int


def walk(model: RobotModel) -> Iterator[TreeEntry]:
    """All links of `model`, parents before children, in the order of the model."""
    stack = [(model.root, 0, 0)]
    while stack:
        link, depth, rank = stack.pop()
        children = model.children(link)
        yield TreeEntry(link, depth, rank, len(children))
        stack.extend(
            (child, depth + 1, number)
            for number, child in reversed(list(enumerate(children, start=1)))
        )


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
    # every link but one has a parent: whatever the root does not reach turns in a circle
    reached = set(roots)
    frontier = set(roots)
    while frontier:
        frontier = {joint.child for joint in joints if joint.parent in frontier} - reached
        reached |= frontier
    if len(reached) < len(links):
        circle = ", ".join(link for link in links if link not in reached)
        raise RobotModelError(
            f"the links {circle} are connected in a circle; each must lead up to one root"
            if links
            else "the model has no links"
        )
    if not roots:
        raise RobotModelError("the model has no links")
    return roots[0]
