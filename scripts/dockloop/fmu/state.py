"""A saved state of an FMU as a recording."""

from pathlib import Path

from fmpy.fmi1 import FMICallException

from dockloop.base.errors import UsageError
from dockloop.base.files import scratch
from dockloop.base.paths import read_bytes, shown
from dockloop.fmu.host import Instance, Recorder, communication_points, unpack_fmu
from dockloop.result.recording import Result


def read_state(fmu: Path, state: Path) -> Result:
    """Return all outputs of an FMU in a saved state, as a recording of one sample at time 0.

    Args:
        fmu: the FMU in which the state was saved.
        state: a file with the bytes of fmi2SerializeFMUstate.

    Raises:
        UsageError: one of the files is none, or the state is of another FMU.
    """
    content = read_bytes(state, "file of a saved state")
    with scratch() as folder:
        description, scene = unpack_fmu(fmu, folder)
        times = communication_points(description, None, None)
        with Instance(description, str(folder), shown(fmu)) as instance:
            instance.initialise([], times)
            slave = instance.slave
            recorder = Recorder(slave, description, 1)
            try:
                found = slave.deSerializeFMUstate(content)
                slave.setFMUstate(found)
                slave.freeFMUstate(found)
                recorder.read(0, 0.0)
                parameters = instance.read_parameters()
            except FMICallException as error:
                raise UsageError(
                    f"{shown(state)}: is no state of {shown(fmu)} ({instance.sentence(error)})"
                ) from None
    return Result(scene, recorder.names, recorder.units, recorder.values, parameters)
