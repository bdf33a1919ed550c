"""Makes ``python -m dockloop`` the same as the command ``dockloop``."""

import sys

from dockloop.cli import main

sys.exit(main())
