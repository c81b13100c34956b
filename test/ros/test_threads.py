"""Threads of a node: an error in one of them is reported, and ends nothing else."""

from contextlib import closing

from rclpy.node import Node
from std_srvs.srv import Trigger
from waiting import wait_for

from head_tracking.ros.kit.threads import UrgentServices, Worker


def test_an_error_of_a_worker_ends_the_node_by_its_next_offer():
    def work(_):
        raise KeyError("broken")

    def offered():
        try:
            worker.offer(1)
        except KeyError:
            return True
        return False

    with closing(Worker("work", work)) as worker:
        wait_for(offered)


def test_an_error_of_an_urgent_service_is_an_answer_without_success(threads):
    def fail(request):
        raise RuntimeError

    person, bus = Node("person"), Node("bus")
    threads.start(person)
    with closing(UrgentServices(bus)) as services:
        services.offer("fail", fail)
        services.start()
        client = person.create_client(Trigger, "fail")
        wait_for(client.service_is_ready)
        for _ in range(2):
            future = client.call_async(Trigger.Request())
            wait_for(future.done)
            assert not future.result().success
    bus.destroy_node()
