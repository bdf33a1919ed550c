"""All cases, in the order of the page."""

import brake_speed
import central_impact
import contact_cases
import differential
import heavy_vehicles
import held_feedback
import idss_box
import latch_failure
import least_speed
import massless_ring
import recovery
import sensitivity
import time_scales

CASES = tuple(
    module.CASE
    for module in (
        central_impact,
        recovery,
        least_speed,
        differential,
        time_scales,
        contact_cases,
        massless_ring,
        idss_box,
        held_feedback,
        heavy_vehicles,
        sensitivity,
        latch_failure,
        brake_speed,
    )
)
