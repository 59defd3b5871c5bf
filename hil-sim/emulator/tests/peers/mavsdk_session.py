"""MAVSDK beside an autopilot that forwards to the flash image: parameters listed and set, the camera found.

usage: mavsdk_session.py TELEM1 COUNT
"""

import sys

from mavsdk.param import ParamError, ProtocolVersion
from mavsdk_peer import connected, first, run
from vehicle import PX4, Vehicle

terminal, count = sys.argv[1], int(sys.argv[2])
PORT = 14571
# Every script has a server of its own.
SERVER = 50071


async def main():
    system = await connected(PORT, SERVER, 255)
    try:
        await system.param.select_component(191, ProtocolVersion.V1)
    except ParamError as error:
        # The server of 3.17 answers UNKNOWN to a request that it has carried out.
        print("select_component:", error)
    params = await system.param.get_all_params()
    names = {param.name for param in params.int_params + params.float_params}
    assert len(names) == count and "SPD_MARGIN" in names, (len(names), sorted(names)[:5])
    assert abs(await system.param.get_param_float("SPD_MARGIN") - 0.9) < 1e-6
    await system.param.set_param_float("SPD_MARGIN", 0.75)
    assert await system.param.get_param_float("SPD_MARGIN") == 0.75
    await system.param.set_param_int("RIG_IMAGES", 11)
    assert await system.param.get_param_int("RIG_IMAGES") == 11
    await system.param.set_param_float("SPD_MARGIN", 0.9)
    await system.param.set_param_int("RIG_IMAGES", 12)
    cameras = await first(system.camera.camera_list(), lambda list: list.cameras)
    camera = cameras.cameras[0]
    assert (camera.vendor_name, camera.model_name) == ("Adit", "Rotator"), camera
    print("MAVSDK:", len(names), "parameters, camera", camera.vendor_name, camera.model_name)


vehicle = Vehicle(terminal, PX4, ground=PORT)
try:
    run(main)
finally:
    vehicle.close()
