"""An autopilot's side of a telemetry line, on pymavlink: it lives, and forwards between the board and ground stations."""

import os

os.environ["MAVLINK20"] = "1"

import socket
import threading
import time

import serial
from pymavlink.dialects.v20 import all as mavlink

ARDUPILOT, PX4 = 3, 12
# ArduPilot's Auto, PX4's Mission.
MODES = {ARDUPILOT: 3, PX4: 4 << 16 | 4 << 24}


class Vehicle(threading.Thread):
    """Runs on a terminal until it is closed; keeps every message of the board, and strictly none that cannot be read."""

    def __init__(self, terminal, autopilot=ARDUPILOT, ground=None):
        super().__init__(daemon=True)
        self.port = serial.Serial(terminal, 921600, timeout=0)
        self.autopilot = autopilot
        self.mav = mavlink.MAVLink(None, 1, 1)
        self.reader = mavlink.MAVLink(None)
        self.reader.robust_parsing = True
        self.messages, self.bad = [], []
        self.lock = threading.Lock()
        self.ground = ("127.0.0.1", ground) if ground else None
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.runs = True
        self.start()

    def run(self):
        beat_at = 0.0
        while self.runs:
            data = self.port.read(4096)
            if data:
                self.hear(data)
                if self.ground:
                    self.socket.sendto(data, self.ground)
            try:
                while True:
                    self.port.write(self.socket.recvfrom(65536)[0])
            except (BlockingIOError, ConnectionRefusedError):
                pass
            if time.monotonic() - beat_at > 0.4:
                beat_at = time.monotonic()
                # A quadrotor, armed, active.
                self.say(mavlink.MAVLink_heartbeat_message(2, self.autopilot, 0x81, MODES[self.autopilot], 4, 3))
            if not data:
                time.sleep(0.002)

    def hear(self, data):
        for message in self.reader.parse_buffer(data) or []:
            with self.lock:
                (self.bad if message.get_type() in ("BAD_DATA",) else self.messages).append(message)

    def say(self, message, mav=None):
        frame = message.pack(mav or self.mav)
        self.port.write(frame)
        if self.ground:
            self.socket.sendto(frame, self.ground)

    def take(self):
        with self.lock:
            taken, self.messages = self.messages, []
        return taken

    def wait(self, fits, seconds=20.0):
        """The first message that fits, those behind it left for the next; fails if none comes."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            taken = self.take()
            for place, message in enumerate(taken):
                if fits(message):
                    with self.lock:
                        self.messages = taken[place + 1 :] + self.messages
                    return message
            time.sleep(0.01)
        raise AssertionError("no such message")

    def close(self):
        self.runs = False
        self.join()
        self.port.close()


def ground_station():
    """A ground station's sender."""
    return mavlink.MAVLink(None, 255, 190)
