"""pymavlink as a ground station: the flash image's parameters, in the encoding of either autopilot.

usage: parameters.py TELEM1 TELEM2 COUNT
"""

import struct
import sys
import time

from vehicle import ARDUPILOT, PX4, Vehicle, ground_station, mavlink

telem1, telem2, count = sys.argv[1], sys.argv[2], int(sys.argv[3])


def whole(message, autopilot):
    """A whole number: bytes for PX4, a converted single for ArduPilot."""
    if autopilot == ARDUPILOT:
        return int(message.param_value)
    return struct.unpack("<i", struct.pack("<f", message.param_value))[0]


for autopilot in (ARDUPILOT, PX4):
    vehicle, station = Vehicle(telem1, autopilot), ground_station()
    # The board has heard this autopilot when the service port says so too.
    vehicle.wait(lambda m: m.get_type() == "HEARTBEAT" and m.get_srcComponent() == 191)
    time.sleep(1.5)
    named = {}

    def complete():
        for message in vehicle.take():
            if message.get_type() == "PARAM_VALUE":
                named[message.param_id] = message
        return len(named) == count

    vehicle.say(mavlink.MAVLink_param_request_list_message(1, 191), station)
    until = time.monotonic() + 30
    while not complete() and time.monotonic() < until:
        time.sleep(0.05)
    assert len(named) == count, f"{len(named)} of {count}"
    assert sorted(m.param_index for m in named.values()) == list(range(count))
    images = named["RIG_IMAGES"]
    assert (images.param_type, whole(images, autopilot)) == (6, 12), images
    assert abs(named["SPD_MARGIN"].param_value - 0.9) < 1e-6

    # A change is answered when it is kept; what is impossible is answered with the old value.
    wire = 10.0 if autopilot == ARDUPILOT else struct.unpack("<f", struct.pack("<i", 10))[0]
    vehicle.say(mavlink.MAVLink_param_set_message(1, 191, b"RIG_IMAGES", wire, 6), station)
    answer = vehicle.wait(lambda m: m.get_type() == "PARAM_VALUE")
    assert (answer.param_id, whole(answer, autopilot)) == ("RIG_IMAGES", 10), answer
    vehicle.say(mavlink.MAVLink_param_set_message(1, 191, b"SPD_MARGIN", 7.0, 9), station)
    answer = vehicle.wait(lambda m: m.get_type() == "PARAM_VALUE")
    assert (answer.param_id, abs(answer.param_value - 0.9) < 1e-6) == ("SPD_MARGIN", True), answer
    wire = 12.0 if autopilot == ARDUPILOT else struct.unpack("<f", struct.pack("<i", 12))[0]
    vehicle.say(mavlink.MAVLink_param_set_message(1, 191, b"RIG_IMAGES", wire, 6), station)
    vehicle.wait(lambda m: m.get_type() == "PARAM_VALUE")
    assert not vehicle.bad, vehicle.bad
    vehicle.close()
    print("parameters as", "ArduPilot" if autopilot == ARDUPILOT else "PX4", len(named))
