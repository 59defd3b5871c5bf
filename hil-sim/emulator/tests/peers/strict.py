"""Every byte that a board said in a flight is a message that pymavlink reads, in every dialect that knows it.

usage: strict.py FILE NAME...   FILE: the bytes; NAME: messages that must be among them
"""

import importlib
import os
import sys
from collections import Counter

os.environ["MAVLINK20"] = "1"

# SET_VELOCITY_LIMITS is in development.xml of MAVLink, and in no dialect that pymavlink ships.
DIALECTS = ["all", "ardupilotmega", "common", "development"]

data = open(sys.argv[1], "rb").read()
for dialect in DIALECTS:
    mavlink = importlib.import_module(f"pymavlink.dialects.v20.{dialect}")
    reader = mavlink.MAVLink(None)
    # Not robust: anything that is no message raises.
    reader.robust_parsing = False
    counts = Counter(message.get_type() for message in reader.parse_buffer(data) or [])
    assert reader.total_receive_errors == 0, f"{dialect}: {reader.total_receive_errors} errors"
    missing = [name for name in sys.argv[2:] if not counts[name]]
    assert not missing, f"{dialect}: no {missing} among {dict(counts)}"
    print(dialect, sum(counts.values()), dict(sorted(counts.items())))
