"""Random robots, as URDF text, for comparing one computation with another."""

import random

AXES = (
    "1 0 0",
    "0 1 0",
    "0 0 -1",
    "0.6 0 0.8",
    "0.2672612419124244 0.5345224838248488 -0.8017837257372732",
)


def random_urdf(seed: int, links: int = 20) -> str:
    """A tree of `links` links under all joint types, some joints mimicking an independent one."""
    rnd = random.Random(seed)
    parts = [f'<robot name="random_{seed}">', '<link name="link_0"/>']
    followed = ""
    for number in range(1, links):
        kind = rnd.choice(("fixed", "revolute", "continuous", "prismatic"))
        parts += [
            f'<link name="link_{number}"/>',
            f'<joint name="joint_{number}" type="{kind}">',
            f'<parent link="link_{rnd.randrange(number)}"/><child link="link_{number}"/>',
            f'<origin xyz="{_numbers(rnd, 0.5)}" rpy="{_numbers(rnd, 3.0)}"/>',
        ]
        if kind != "fixed":
            parts.append(f'<axis xyz="{rnd.choice(AXES)}"/>')
            if kind != "continuous":
                parts.append('<limit lower="-3" upper="3" effort="1" velocity="1"/>')
            if followed and rnd.random() < 0.25:
                parts.append(
                    f'<mimic joint="{followed}" multiplier="{rnd.uniform(-2, 2)}" '
                    f'offset="{rnd.uniform(-1, 1)}"/>'
                )
            else:
                followed = followed or f"joint_{number}"
        parts.append("</joint>")
    return "\n".join([*parts, "</robot>"])


def _numbers(rnd: random.Random, size: float) -> str:
    return " ".join(f"{rnd.uniform(-size, size):.6f}" for _ in range(3))
