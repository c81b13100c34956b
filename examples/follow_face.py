"""Follow a face that a camera on the head sees. Needs OpenCV: pip install 'head_tracking[vision]'.

python examples/follow_face.py /dev/ttyUSB0     or, without hardware: --sim
"""

import math
import sys
import time
from functools import partial

from head_tracking import Head
from head_tracking.scene import film


def main(port: str = "--sim") -> None:
    """Run the example."""
    with Head.simulated() if port == "--sim" else Head.open(port) as head:
        if port == "--sim":  # a drawn person who moves from side to side
            where = partial(head.pose, "camera_optical_frame", "base_link")
            camera = head.follow_camera("face", film("face", lambda t: where(stamp=t)))
        else:
            camera = head.follow_camera("face", 0)
        end = time.time() + 6.0
        while time.time() < end and not camera.wait(0.5):
            face = camera.sighting
            if face is None or head.error is None:
                print("no face")
            else:
                away = math.dist((0, 0, 0), face.point)
                print(f"{head.state}: {math.degrees(head.error):.1f} degrees, {away:.1f} m away")
        if camera.error is not None:
            print(camera.error)


if __name__ == "__main__":
    main(*sys.argv[1:])
