import math

import pytest

from head_tracking.tracking import FictitiousTarget, FictitiousTargetParameters


def test_the_path_is_the_tutorials():
    target = FictitiousTarget(FictitiousTargetParameters())
    for index in range(600):
        t = 0.025 * (index + 1)
        x, y, z = target.advance()
        assert x == pytest.approx(0.5 + 0.25 * math.sin(t))
        assert y == pytest.approx(0.5 * math.sin(t))
        assert z == pytest.approx(-0.1 + 0.5 * abs(math.sin(t)))


def test_a_late_message_is_farther_along_the_path():
    target, other = (FictitiousTarget(FictitiousTargetParameters()) for _ in range(2))
    for _ in range(3):
        point = target.advance()
    assert other.advance(3.0) == pytest.approx(point)


def test_a_centre_needs_three_numbers():
    with pytest.raises(ValueError, match="center"):
        FictitiousTargetParameters(center=(1.0, 2.0))


def test_the_harmonic_path_has_the_tutorials_ends_and_no_jerk():
    step = 0.025
    targets = {
        path: FictitiousTarget(FictitiousTargetParameters(path=path, step=step))
        for path in ("tutorial", "harmonic")
    }
    heights = {path: [target.advance()[2] for _ in range(600)] for path, target in targets.items()}
    for path, z in heights.items():
        assert min(z) == pytest.approx(-0.1, abs=1e-3), path
        assert max(z) == pytest.approx(0.4, abs=1e-3), path

    def hardest(z: list[float]) -> float:
        """The largest acceleration [m/rad^2]."""
        bends = zip(z, z[1:], z[2:], strict=False)
        return max(abs(a - 2.0 * b + c) for a, b, c in bends) / step**2

    assert hardest(heights["harmonic"]) < 1.01  # 2 * 0.5 m, at both ends
    assert hardest(heights["tutorial"]) > 20.0
