"""Reads a record and a file of parameters as pymavlink does; prints what is there, one line each."""

import os
import sys

os.environ["MAVLINK20"] = "1"
from pymavlink import mavparm, mavutil  # noqa: E402

record, parameters = sys.argv[1:]
log = mavutil.mavlink_connection(record, dialect="common")
found, last = set(), 0.0
while (message := log.recv_msg()) is not None:
    if message.get_type() == "BAD_DATA":
        print("bad data")
    if message._timestamp < last:
        print("time runs back")
    last = message._timestamp
    found.add(f"{message.get_srcSystem()}/{message.get_srcComponent()} {message.get_type()}")
for line in sorted(found):
    print(line)

values = mavparm.MAVParmDict()
values.load(parameters, use_excludes=False)
for name in sorted(values):
    print(f"{name} {values[name]:g}")
