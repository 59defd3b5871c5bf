"""Runs a command and writes what it took: measure.py RESULT.json COMMAND..."""

import json
import resource
import subprocess
import sys
import time

started = time.monotonic()
child = subprocess.run(sys.argv[2:], check=False)
figures = {
    "status": child.returncode,
    "seconds": time.monotonic() - started,
    # The largest resident set of the child, in KiB on Linux.
    "peak_mib": resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024,
}
with open(sys.argv[1], "w", encoding="utf-8") as file:
    json.dump(figures, file)
