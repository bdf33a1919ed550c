"""Reference result: what the default experiment of an FMU gave where it was built.

A user of the FMU can compare. Layout of the FMI layered standard for references
(fmi-ls-ref 1.0.0-alpha.1), as the Reference FMUs have it::

    extra/org.fmi-standard.fmi-ls-ref/fmi-ls-manifest.xml   what is there
    extra/org.fmi-standard.fmi-ls-ref/NAME_out.csv          time and all outputs

The run has the steps of the default experiment; the table has about 200 of its rows. Last digits
belong to the machine: compare with the tolerance of the experiment.
"""

import io
import zipfile
from pathlib import Path

import numpy as np

from dockloop.base.files import cannot_write
from dockloop.fmu.host import run_fmu

FOLDER = "extra/org.fmi-standard.fmi-ls-ref"
_ROWS = 200

_MANIFEST = """<?xml version="1.0" encoding="UTF-8"?>
<fmiReferences
    xmlns:fmi-ls="http://fmi-standard.org/fmi-ls-manifest"
    fmi-ls:fmi-ls-name="org.fmi-standard.fmi-ls-ref"
    fmi-ls:fmi-ls-version="1.0.0-alpha.1"
    fmi-ls:fmi-ls-description="Reference result">
  <Related type="text/csv" source="{table}" role="result" description="{description}"/>
</fmiReferences>
"""


def add_reference(fmu: Path) -> None:
    """Run the default experiment of an FMU and add the result to the FMU.

    Args:
        fmu: an FMU without a reference result; half of it may be there after an error.

    Raises:
        DockloopError: the run fails, or the FMU cannot be written.
    """
    run = run_fmu(fmu)
    every = max(1, (len(run.values) - 1) // _ROWS)
    text = io.StringIO()
    names = ",".join(f'"{name}"' for name in run.names)
    np.savetxt(text, run.values[::every], "%.10g", ",", header=names, comments="")
    table = f"{run.scene['name']}_out.csv"
    contents = {
        "fmi-ls-manifest.xml": _MANIFEST.format(
            table=table, description="Outputs of the default experiment"
        ),
        table: text.getvalue(),
    }
    try:
        with zipfile.ZipFile(fmu, "a", zipfile.ZIP_DEFLATED) as archive:
            date = archive.infolist()[0].date_time
            for name, content in contents.items():
                info = zipfile.ZipInfo(f"{FOLDER}/{name}", date)
                info.compress_type = zipfile.ZIP_DEFLATED
                info.external_attr = 0o644 << 16
                archive.writestr(info, content)
    except OSError as error:
        raise cannot_write(fmu, error) from None
