"""Signatures of the flash image against pymavlink's: each believes the other's, and neither believes anything else.

usage: signing.py TELEM1 TELEM2
"""

import sys
import time

import serial
from vehicle import Vehicle, ground_station, mavlink

KEY = bytes(range(32))
telem1, telem2 = sys.argv[1], sys.argv[2]


def signing(mav, key, stamp):
    mav.signing.secret_key = key
    mav.signing.link_id = 3
    mav.signing.timestamp = stamp
    mav.signing.sign_outgoing = True
    return mav


def now():
    """Tens of microseconds since 2015."""
    return int((time.time() - 1420070400) * 100_000)


def version_then_arm(vehicle, station):
    """Whether an ARM command is answered."""
    vehicle.take()
    vehicle.say(mavlink.MAVLink_command_long_message(1, 191, 400, 0, 0.0, 0, 0, 0, 0, 0, 0), station)
    try:
        vehicle.wait(lambda m: m.get_type() == "COMMAND_ACK" and m.command == 400, 3.0)
        return True
    except AssertionError:
        return False


vehicle = Vehicle(telem1)
vehicle.wait(lambda m: m.get_type() == "HEARTBEAT" and m.get_srcComponent() == 191)
assert version_then_arm(vehicle, ground_station()), "without a key everybody commands"

# By radio no key is taken, by cable it is.
vehicle.say(mavlink.MAVLink_setup_signing_message(1, 191, list(KEY), now()), ground_station())
assert version_then_arm(vehicle, ground_station()), "a key by radio has no effect"
cable = serial.Serial(telem2, 921600, timeout=0)
cable.write(mavlink.MAVLink_setup_signing_message(1, 191, list(KEY), now()).pack(ground_station()))
time.sleep(2.0)

assert not version_then_arm(vehicle, ground_station()), "unsigned"
assert not version_then_arm(vehicle, signing(ground_station(), bytes(32), now())), "another key"
owner = signing(ground_station(), KEY, now() + 100_000)
assert version_then_arm(vehicle, owner), "pymavlink's signature is believed"
late = signing(ground_station(), KEY, now() - 200_000)
assert not version_then_arm(vehicle, late), "a clock that runs back"

# What the board says is believed by a reader that takes nothing unsigned.
reader = mavlink.MAVLink(None)
reader.robust_parsing = True
signing(reader, KEY, now() - 6_000_000)
reader.signing.sign_outgoing = False
reader.signing.allow_unsigned_callback = lambda mav, number: False
believed = 0
for message in vehicle.take():
    pass
until = time.monotonic() + 3
while time.monotonic() < until:
    for message in vehicle.take():
        if message.get_srcComponent() not in (100, 191):
            continue
        for read in reader.parse_buffer(message.get_msgbuf()) or []:
            assert read.get_type() != "BAD_DATA", read
            believed += 1
    time.sleep(0.05)
assert believed > 30, believed
assert reader.signing.badsig_count == 0

cable.write(mavlink.MAVLink_setup_signing_message(1, 191, [0] * 32, 0).pack(ground_station()))
time.sleep(1.0)
assert version_then_arm(vehicle, ground_station()), "the key is gone"
vehicle.close()
print("signatures:", believed, "of the board's believed, pymavlink's believed by the board, four wrong ones not")
