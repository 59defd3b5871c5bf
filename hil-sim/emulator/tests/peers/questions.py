"""Everything that can be asked of a board through its autopilot, answered in messages that every dialect reads strictly.

usage: questions.py TELEM1
"""

import importlib
import sys
import time

from vehicle import Vehicle, ground_station, mavlink

vehicle, station = Vehicle(sys.argv[1]), ground_station()
wire = bytearray()
hear = vehicle.hear
vehicle.hear = lambda data: (wire.extend(data), hear(data))
vehicle.wait(lambda m: m.get_type() == "HEARTBEAT" and m.get_srcComponent() == 191)

ANSWERS = {
    148: "AUTOPILOT_VERSION",
    259: "CAMERA_INFORMATION",
    260: "CAMERA_SETTINGS",
    261: "STORAGE_INFORMATION",
    262: "CAMERA_CAPTURE_STATUS",
}
for number, name in ANSWERS.items():
    component = 191 if number == 148 else 100
    vehicle.say(mavlink.MAVLink_command_long_message(1, component, 512, 0, float(number), 0, 0, 0, 0, 0, 0), station)
    answer = vehicle.wait(lambda m: m.get_type() == name)
    assert answer.get_srcComponent() == component, answer

vehicle.say(mavlink.MAVLink_timesync_message(0, 1234567), station)
answer = vehicle.wait(lambda m: m.get_type() == "TIMESYNC")
assert (answer.ts1, answer.tc1 > 0) == (1234567, True), answer

vehicle.say(mavlink.MAVLink_param_request_read_message(1, 191, b"SPD_MARGIN", -1), station)
vehicle.wait(lambda m: m.get_type() == "PARAM_VALUE")

vehicle.say(mavlink.MAVLink_log_request_list_message(1, 191, 0, 0xFFFF), station)
log = vehicle.wait(lambda m: m.get_type() == "LOG_ENTRY")
vehicle.say(mavlink.MAVLink_log_request_data_message(1, 191, log.id, log.size - 100, 1000), station)
assert vehicle.wait(lambda m: m.get_type() == "LOG_DATA").count == 90
assert vehicle.wait(lambda m: m.get_type() == "LOG_DATA").count == 10
time.sleep(0.5)
vehicle.close()
assert not vehicle.bad, vehicle.bad

expected = set(ANSWERS.values()) | {"TIMESYNC", "PARAM_VALUE", "LOG_ENTRY", "LOG_DATA", "COMMAND_ACK", "COMMAND_LONG"}
# The stretch begins with whatever was under way when the vehicle began to listen.
start = wire.index(0xFD)
for dialect in ["all", "ardupilotmega", "common", "development"]:
    reader = importlib.import_module(f"pymavlink.dialects.v20.{dialect}").MAVLink(None)
    reader.robust_parsing = False
    names = {message.get_type() for message in reader.parse_buffer(bytes(wire[start:])) or []}
    assert reader.total_receive_errors == 0 and expected <= names, (dialect, expected - names)
print("answered:", len(expected), "kinds, strictly read in four dialects")
