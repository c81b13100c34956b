"""When a joint may fall silent, and where it stays."""

from __future__ import annotations
import math

class Rest:
    def __init__(self):
        self.resting = False
        self.latched = 0.0
        self.goal = 0.0
        self.since = None
        self.nudged = 0.0

    def update(self, wanted, velocity, motion, servo, now, dead_band, noise, speed_noise):
        band = max(dead_band, min(2 * noise, 2.5 * dead_band))
        still = max(0.015, min(2 * speed_noise, 0.03))
        if self.resting:
            if abs(wanted - self.latched) <= band and abs(velocity) <= 2.5 * still:
                stamp, x = servo.reading
                if stamp - self.nudged > 0.2 and abs(self.latched - x) > dead_band:
                    self.nudged = stamp
                    self.goal += self.latched - x if abs(self.goal - self.latched)<3*servo.resolution else 0
                    side = math.copysign(1.0, self.latched - x)
                    if (self.goal - self.latched) * side < servo.dead_band*.5:
                        self.goal = self.latched + side * servo.dead_band
                return self.goal
            self.resting = False
            self.since = None
            return None
        calm = abs(velocity) <= still and abs(motion.velocity) <= still and abs(wanted - motion.position) <= 0.5 * band
        if not calm:
            self.since = None
            return None
        if self.since is None:
            self.since = now
        if now - self.since < 0.1:
            return None
        self.resting = True
        self.latched = wanted
        self.goal = servo.setpoint(now)
        self.nudged = now
        return self.goal
