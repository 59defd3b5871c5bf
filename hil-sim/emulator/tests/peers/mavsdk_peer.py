"""MAVSDK as a ground station, with a server of its own for every script."""

import asyncio
import os
import threading

from grpc import StatusCode
from grpc.aio import AioRpcError
from mavsdk import System

# A server that does not answer cannot be waited out from within.
helper = threading.Timer(170, os._exit, [3])
helper.daemon = True
helper.start()


async def first(stream, fits):
    """The first item that fits."""
    async for item in stream:
        if fits(item):
            return item


async def connected(port, server, number):
    """The vehicle that speaks on a UDP port, to ground station `number`; `server` is where MAVSDK's own server listens."""
    system = System(port=server, sysid=number, compid=190)
    await system.connect(system_address=f"udpin://127.0.0.1:{port}")
    await first(system.core.connection_state(), lambda state: state.is_connected)
    return system


def run(session):
    """Runs a session; once more from its beginning if MAVSDK's server crashed."""
    try:
        asyncio.run(asyncio.wait_for(session(), 80))
    except AioRpcError as error:
        if error.code() != StatusCode.UNAVAILABLE:
            raise
        print("once more: MAVSDK's server is gone:", error.details())
        asyncio.run(asyncio.wait_for(session(), 80))
