"""All cases, in the order of the page."""

import brake_speed
import central_impact
import held_feedback
import least_speed
import recovery

CASES = tuple(
    module.CASE for module in (central_impact, recovery, least_speed, held_feedback, brake_speed)
)
