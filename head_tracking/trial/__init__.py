"""A head on simulated servos, in simulated time: what benchmarks and closed-loop tests drive."""

from head_tracking.trial.head_trial import Conditions, HeadTrial, Outcome, Path
from head_tracking.trial.simulated_head import SimulatedHead

__all__ = ["Conditions", "HeadTrial", "Outcome", "Path", "SimulatedHead"]
