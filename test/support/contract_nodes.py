"""Small nodes that speak as a servo bus and controllers do, and fail as those should not."""

from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rig import JOINTS
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, Trigger

from head_tracking.ros.kit.topics import LATCHED


class BusStandIn(Node):
    """Offers `stop`, `resume`, `relax`; says who owns the joints, and whether it is stopped."""

    def __init__(
        self, namespace: str = "", offers: tuple[str, ...] = ("stop", "resume", "relax")
    ) -> None:
        super().__init__("servo_bus", namespace=namespace)
        self.calls: list[str] = []  # the services that were called, oldest first
        self.confirms = set(JOINTS)  # joints that confirm that they are relaxed
        self.commands: list[JointState] = []  # messages on joint_commands
        self.claims: list[JointState] = []  # messages on joint_claims
        self.message = "torque on"  # of the servos' diagnostics
        self._epoch = 0
        self._control = self.create_publisher(DiagnosticStatus, "joint_control", LATCHED)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_subscription(JointState, "joint_commands", self.commands.append, 10)
        self.create_subscription(JointState, "joint_claims", self.claims.append, 10)
        self._offered = {}
        for name in offers:
            offered = self.create_service(Trigger, name, self._callback(name))
            self._offered[f"service {name.removeprefix('~/')}"] = offered.service_name
        for joint in JOINTS:
            controller = joint.replace("joint", "controller")
            self.create_service(SetBool, f"{controller}/torque_enable", self._on_torque)
        self.create_timer(0.3, self.diagnose)
        self.say_stopped(False)

    def own(self, owner: str, stopped: bool = False, epoch: int = 0) -> None:
        """Who has the joints from now on, in a program that heeds the epochs of STOP."""
        fields = {"stopped": str(stopped).lower(), "epoch": str(epoch)}
        fields |= {"node": self.get_fully_qualified_name(), **self._offered}
        fields |= {f"owner of {joint}": owner for joint in JOINTS}
        values = [KeyValue(key=key, value=value) for key, value in fields.items()]
        self._control.publish(DiagnosticStatus(name="joint_control", values=values))

    def say_stopped(self, stopped: bool) -> None:
        self._epoch += stopped
        self.own("", stopped, self._epoch)

    def diagnose(self) -> None:
        """Says that the servos are there, with the present message."""
        name = self.get_fully_qualified_name().removeprefix("/")
        status = [
            DiagnosticStatus(
                name=f"{name}: {joint}",
                level=DiagnosticStatus.OK,
                message=self.message,
                values=[
                    KeyValue(key="joint", value=joint),
                    KeyValue(key="controller", value=joint.replace("joint", "controller")),
                    KeyValue(key="torque", value="torque on"),
                ],
            )
            for joint in JOINTS
        ]
        self._diagnostics.publish(DiagnosticArray(status=status))

    def _on_torque(self, _: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.success = True
        return response

    def _callback(self, name: str) -> Any:
        def callback(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            self.calls.append(name)
            response.success = name.endswith("resume") or self.confirms == set(JOINTS)
            response.message = ", ".join(
                f"{joint} {'relaxed' if joint in self.confirms else 'NOT confirmed'}"
                for joint in JOINTS
            )
            if name.endswith(("stop", "resume")):
                self.say_stopped(name.endswith("stop"))
            return response

        return callback


class ControllerStandIn(Node):
    """head_tracker or point_head: a switch and a latched topic."""

    def __init__(self, name: str, on: bool = True, namespace: str = "") -> None:
        super().__init__(name, namespace=namespace)
        self.on = on  # whether it is switched on
        self.asked: list[bool] = []  # what `~/enable` was called with
        self._enabled = self.create_publisher(Bool, "~/enabled", LATCHED)
        self.create_service(SetBool, "~/enable", self._on_enable)
        self._enabled.publish(Bool(data=on))

    def switch(self, on: bool) -> None:
        """Somebody else has switched it."""
        self.on = on
        self._enabled.publish(Bool(data=on))

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.asked.append(request.data)
        self.switch(request.data)
        response.success = True
        return response
