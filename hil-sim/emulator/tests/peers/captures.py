"""MAVSDK watches a flight of the flash image: a vehicle, our component beside it, and every capture.

usage: captures.py EMULATOR IMAGE MISSION OUT
"""

import subprocess
import sys

from mavsdk_peer import connected, first, run

emulator, image, mission, out = sys.argv[1:]
PORT = 14572
# Every script has a server of its own.
SERVER = 50072
WANTED = 5


async def main():
    system = await connected(PORT, SERVER, 254)
    position = await first(system.telemetry.position_velocity_ned(), lambda ned: True)
    print("vehicle at", round(position.position.north_m, 2), "m north")
    await first(system.camera.camera_list(), lambda list: list.cameras)
    seen = []
    async for capture in system.camera.capture_info():
        seen.append(capture.index)
        if len(seen) >= WANTED:
            break
    assert seen == list(range(seen[0], seen[0] + WANTED)), seen
    print("captures", seen)


flight = subprocess.Popen(
    [emulator, "fly", mission, "--out", out, "--image", image, "--no-photos", "--realtime"]
    + ["--mavlink", f"udpout:127.0.0.1:{PORT}"],
    stdout=subprocess.DEVNULL,
)
try:
    run(main)
finally:
    flight.kill()
