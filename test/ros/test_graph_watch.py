"""Who counts as another head in a run's graph, and what the run does about it."""

import math
from contextlib import ExitStack
from types import SimpleNamespace

import pytest
import rclpy
from geometry_msgs.msg import PointStamped
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from waiting import eventually

from head_tracking.exceptions import RefusedError
from head_tracking.ros import graph_watch
from head_tracking.ros.graph_watch import LOOK_TIME, STARTING, GraphWatch
from head_tracking.run import control as runner
from head_tracking.run.status_line import StatusLine

RUN = "/head_tracking/simulated_01_this"
OLDER = RUN.replace("_01", "_00")
YOUNGER = RUN.replace("_01", "_02")


class Graph:
    """A watched run, and whatever else is there."""

    def __init__(self, resources: ExitStack) -> None:
        self._resources = resources
        self.held: list[str] = []
        self.now = 0.0
        self.run = self.node("run_monitor", RUN)

    def node(self, name: str, enclave: str, namespace: str = "") -> Node:
        """A node of a process of its own, for all that DDS knows."""
        context = Context()
        rclpy.init(
            args=["--ros-args", "--enclave", enclave],
            context=context,
            signal_handler_options=SignalHandlerOptions.NO,
        )
        self._resources.callback(context.try_shutdown)
        node = Node(name, context=context, namespace=namespace)
        self._resources.callback(node.destroy_node)
        return node

    def watch(
        self, enclave: str = RUN, *, simulated: bool = True, allow_others: bool = False
    ) -> GraphWatch:
        context = self.run.context if enclave == RUN else self.node("another_run", enclave).context
        return GraphWatch(
            enclave,
            simulated=simulated,
            allow_others=allow_others,
            context=context,
            clock=lambda: self.now,
        )

    def begin(self, watch: GraphWatch) -> None:
        """Nobody is there, and the run moves."""
        self.look(watch, LOOK_TIME)
        assert watch.alone
        watch.begin(self.run)

    def look(self, watch: GraphWatch, seconds: float) -> None:
        """As long as that, four times a second."""
        end = self.now + seconds
        while self.now < end:
            self.now += 0.25
            watch.look()
            if watch.held not in self.held[-1:]:
                self.held.append(watch.held)

    def finds(self, watch: GraphWatch, words: str) -> bool:
        """Whether the watch says this before long; a node's topics and services come one by one."""

        def found() -> bool:
            self.now += 0.05
            watch.look()
            return watch.others == words

        return eventually(found)


@pytest.fixture
def graph(domain, monkeypatch):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    with ExitStack() as resources:
        yield Graph(resources)


def bus(node: Node) -> None:
    node.create_publisher(JointState, "servo_states", 10)
    node.create_subscription(JointState, "joint_commands", print, 10)


def stoppable_bus(node: Node) -> None:
    node.create_service(Trigger, "stop", print)
    node.create_subscription(JointState, "joint_commands", print, 10)


def turns_a_head(node: Node) -> None:
    node.create_subscription(String, "joint_owners", print, 10)
    node.create_subscription(PointStamped, "target_point", print, 10)
    node.create_publisher(JointState, "joint_commands", 10)
    node.create_service(Trigger, "~/recenter", print)


def commands(node: Node) -> None:
    node.create_publisher(JointState, "joint_commands", 10)


def page(node: Node) -> None:
    node.create_publisher(JointState, "joint_commands", 10)
    node.create_publisher(PointStamped, "target_point", 10)
    node.create_subscription(String, "joint_owners", print, 10)


def listens_to_everything(node: Node) -> None:
    for topic in ("joint_commands", "servo_states", "joint_states"):
        node.create_subscription(JointState, topic, print, 10)
    node.create_subscription(PointStamped, "target_point", print, 10)
    node.create_subscription(String, "joint_owners", print, 10)
    node.create_service(Trigger, "~/is_paused", print)


def sends_targets(node: Node) -> None:
    node.create_publisher(PointStamped, "target_point", 10)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (bus, "/stranger (moves servos)"),
        (stoppable_bus, "/stranger (moves servos)"),
        (turns_a_head, "/stranger (turns a head)"),
        (commands, "/stranger (publishes /joint_commands)"),
    ],
)
def test_another_head_is_found_by_what_it_does(graph, make, words):
    make(graph.node("stranger", "/"))
    assert graph.finds(graph.watch(allow_others=True), words)


def test_a_head_of_the_same_names_is_another_one(graph):
    turns_a_head(graph.run)
    turns_a_head(graph.node("run_monitor", YOUNGER))
    assert graph.finds(graph.watch(allow_others=True), "/run_monitor (turns a head)")


def seen(graph: Graph, name: str) -> bool:
    return name in graph.run.get_node_names()


@pytest.mark.parametrize("make", [page, listens_to_everything, sends_targets])
def test_who_only_listens_or_asks_before_it_commands_is_no_head(graph, make):
    make(graph.node("stranger", "/"))
    commands(graph.node("late", "/"))  # is there as soon as this is found, and its topics, too
    watch = graph.watch(allow_others=True)
    assert graph.finds(watch, "/late (publishes /joint_commands)")
    assert eventually(lambda: seen(graph, "stranger"))
    watch.look()
    assert "stranger" not in watch.others


def test_a_child_of_the_run_and_a_head_in_another_namespace_do_not_count(graph):
    bus(graph.node("servo_bus", RUN))
    turns_a_head(graph.node("head_tracker", "/", namespace="/second"))
    watch = graph.watch()
    assert eventually(lambda: seen(graph, "servo_bus") and seen(graph, "head_tracker"))
    graph.begin(watch)
    graph.look(watch, LOOK_TIME)
    assert watch.others == ""
    assert graph.held == ["looking for other heads", ""]


def test_nothing_may_move_before_it_was_looked_for_long_enough(graph):
    watch = graph.watch(simulated=False)
    graph.look(watch, LOOK_TIME - 0.5)
    assert not watch.alone
    graph.look(watch, 0.5)
    assert watch.alone
    assert graph.held == ["looking for other heads"]


@pytest.mark.parametrize("simulated", [False, True])
def test_a_run_that_finds_another_head_refuses_to_start(graph, simulated):
    watch = graph.watch(simulated=simulated)
    bus(graph.node("servo_bus", "/"))
    assert eventually(lambda: graph.run.count_publishers("servo_states") > 0)
    assert eventually(lambda: seen(graph, "servo_bus"))
    assert eventually(lambda: graph.run.count_subscribers("joint_commands") > 0)
    with pytest.raises(RefusedError, match=r"/servo_bus .moves servos.*ROS_DOMAIN_ID.*--allow-o"):
        graph.look(watch, LOOK_TIME)
    assert graph.held == ["looking for other heads"]


@pytest.mark.parametrize("simulated", [False, True])
def test_a_head_that_comes_later_is_said_once_and_only_a_simulated_run_holds(graph, simulated):
    watch = graph.watch(simulated=simulated)
    graph.begin(watch)
    said: list[str] = []
    log = graph.run.get_logger()
    log.warning = said.append  # type: ignore[method-assign,assignment]
    late = graph.node("late", "/")
    commands(late)
    assert graph.finds(watch, "/late (publishes /joint_commands)")
    graph.look(watch, 10.0)
    assert len(said) == 1
    assert "/late (publishes /joint_commands)" in said[0]
    assert ("holds" if simulated else "goes on") in said[0]
    assert bool(watch.held) is simulated
    late.destroy_node()
    assert eventually(lambda: not seen(graph, "late"))
    graph.look(watch, 10.0)
    assert watch.held == ""


def test_who_was_told_to_allow_others_holds_nothing(graph):
    watch = graph.watch(allow_others=True)
    bus(graph.node("servo_bus", "/"))
    assert graph.finds(watch, "/servo_bus (moves servos)")
    assert watch.alone
    watch.begin(graph.run)
    graph.look(watch, 10.0)
    assert graph.held == [""]


def test_who_goes_at_once_is_no_reason_to_refuse(graph):
    """A run that is being started anew may still hear of the one before."""
    watch = graph.watch()
    before = graph.node("servo_bus", "/")
    bus(before)
    assert graph.finds(watch, "/servo_bus (moves servos)")
    before.destroy_node()
    assert eventually(lambda: not seen(graph, "servo_bus"))
    graph.begin(watch)


@pytest.mark.parametrize("simulated", [False, True])
def test_of_runs_that_start_at_the_same_moment_the_oldest_goes_on(graph, simulated):
    own = graph.watch(simulated=simulated)
    older = graph.watch(OLDER, simulated=simulated)
    younger = graph.watch(YOUNGER, simulated=simulated)
    for watch in (own, younger):
        assert graph.finds(watch, f"/{STARTING} (a run that starts, before this one)")
    assert eventually(lambda: graph.run.get_node_names().count(STARTING) == 3)
    for watch in (own, younger):
        with pytest.raises(RefusedError, match=r"before this one.*ROS_DOMAIN_ID"):
            graph.look(watch, LOOK_TIME)
    graph.look(older, LOOK_TIME)
    assert older.alone


@pytest.mark.parametrize(
    ("others", "holds"), [([OLDER], True), ([YOUNGER], False), ([OLDER, YOUNGER], True)]
)
def test_of_runs_that_hear_of_each_other_too_late_the_younger_ones_hold(graph, others, holds):
    watch = graph.watch(simulated=False)
    graph.begin(watch)
    late = [graph.watch(other) for other in others]  # which look as yet, and would refuse to start
    for other in others:
        bus(graph.node("servo_bus", other))
    names = graph.run.get_node_names
    for name in (STARTING, "servo_bus"):
        assert eventually(lambda name=name: names().count(name) == len(others))
    graph.look(watch, 10.0)
    assert watch.held == ""
    for other in late:
        other.begin(graph.run)
    assert eventually(lambda: STARTING not in names())
    assert graph.finds(watch, "/servo_bus (moves servos)")
    graph.look(watch, 1.0)
    assert ("another head" in watch.held) is holds


def test_a_node_is_judged_when_all_its_topics_are_known(graph):
    """A page's publisher may be heard of before its subscription."""
    watch = graph.watch()
    stranger = graph.node("stranger", "/")
    commands(stranger)
    topic = "joint_commands"
    assert eventually(lambda: "stranger" in names(graph.run.get_publishers_info_by_topic(topic)))
    graph.look(watch, 1.5)
    assert watch.others == ""
    assert not watch.alone
    stranger.create_subscription(String, "joint_owners", print, 10)
    topic = "joint_owners"
    assert eventually(lambda: "stranger" in names(graph.run.get_subscriptions_info_by_topic(topic)))
    graph.begin(watch)


def names(endpoints) -> set[str]:
    return {end.node_name for end in endpoints}


class Run:
    """A run in a graph that is none: what it has is heard by others after a while."""

    def __init__(self, number: int, plan: tuple, runs: list["Run"]) -> None:
        simulated, self.start, wrong_clock, self.makes, self.heard_after = plan
        kind = "simulated" if simulated else "real"
        self.enclave = f"/head_tracking/{kind}_{1000 + self.start + wrong_clock:09.2f}_{number}"
        self.simulated, self.runs = simulated, runs
        self.now, self.refused, self.watch = 0.0, False, None
        self.had: list[tuple[float, tuple[str, ...]]] = [(0.0, ())]

    def has(self, *names: str) -> None:
        self.had.append((self.now, names))

    def step(self, now: float, monkeypatch) -> None:
        self.now = now
        if self.refused or now < self.start:
            return
        if self.watch is None:
            monkeypatch.setattr(graph_watch, "Node", lambda *_, **__: self)
            self.watch = GraphWatch(self.enclave, simulated=self.simulated, clock=lambda: self.now)
            self.has(STARTING)
            self.made = math.inf if self.simulated else now + self.makes
        if now >= self.made and "servo_bus" not in self.had[-1][1]:
            self.has(STARTING, "servo_bus")
        if self.made < math.inf and now < self.made:
            return  # its nodes are being made
        try:
            self.watch.look()
        except RefusedError:
            self.refused = True
            self.has()
            return
        if self.watch.alone and self.made == math.inf:
            self.made = now + self.makes
        elif self.watch.alone and self.watch.looking:
            self.watch.begin(self)
            self.has("servo_bus")

    @property
    def moves(self) -> bool:
        return not (self.refused or self.watch.looking or self.watch.held)

    # what a node tells of the graph

    def get_node_names_and_namespaces_with_enclaves(self) -> list[tuple[str, str, str]]:
        found = []
        for number, run in enumerate(self.runs):
            heard = self.now if run is self else self.now - 0.05
            if run is not self and self.now < max(self.start, run.start) + self.heard_after[number]:
                continue
            names = [names for when, names in run.had if when <= heard]
            found += [(name, "/", run.enclave) for name in (names or [()])[-1]]
        return found

    def get_publishers_info_by_topic(self, topic: str) -> list[SimpleNamespace]:
        nodes = self.get_node_names_and_namespaces_with_enclaves()
        wanted = topic in ("servo_states", "joint_commands")
        return [SimpleNamespace(node_name=n, node_namespace="/") for n, *_ in nodes if wanted]

    get_subscriptions_info_by_topic = get_publishers_info_by_topic

    def get_service_names_and_types_by_node(self, *_: str) -> list[tuple[str, list[str]]]:
        return []

    def resolve_topic_name(self, name: str) -> str:
        return name

    resolve_service_name = resolve_topic_name

    def get_namespace(self) -> str:
        return "/"

    def get_logger(self) -> SimpleNamespace:
        return SimpleNamespace(warning=len, info=len)

    def destroy_node(self) -> None:
        pass


@settings(max_examples=100)
@given(
    st.lists(
        st.tuples(
            st.booleans(),
            st.sampled_from([0.0, 0.01, 0.4, 1.1, 5.0]),
            st.sampled_from([0.0, -3.0, 3.0]),
            st.sampled_from([0.3, 2.5]),
            st.lists(st.sampled_from([0.05, 0.6, 1.8, 3.2]), min_size=3, max_size=3),
        ),
        min_size=2,
        max_size=3,
    )
)
def test_whoever_hears_of_whom_and_when_in_the_end_exactly_one_run_moves(plans):
    runs: list[Run] = []
    runs += [Run(number, plan, runs) for number, plan in enumerate(plans)]
    with pytest.MonkeyPatch.context() as monkeypatch:
        for tick in range(150):
            for run in runs:
                run.step(0.1 * tick, monkeypatch)
    assert [run.moves for run in runs].count(True) == 1


class NeverStopped:
    def __call__(self) -> bool:
        return False

    def check(self) -> None:
        pass

    def wait(self, _: float) -> None:
        pass


def test_a_simulated_run_looks_before_it_has_any_node_to_hear_of(monkeypatch):
    """A real head would take a simulated one's target and joints for its own."""

    def look(_: GraphWatch) -> None:
        raise RefusedError("another head is in this graph")

    monkeypatch.setattr(GraphWatch, "look", look)
    monkeypatch.setattr(runner, "compose", lambda *_: pytest.fail("its nodes were made"))
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        with pytest.raises(RefusedError, match="another head"):
            runner.run(runner.parse_arguments(["--sim"]), NeverStopped(), StatusLine())
    finally:
        rclpy.try_shutdown()
