"""When the first kernels were read: sources that are newer are not what runs."""

from __future__ import annotations

import time

#: Seconds since the epoch.
STARTED = time.time()
