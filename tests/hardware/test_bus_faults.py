"""Faults on servo buses drawn at random: a playback is whole, or stopped with the right cause."""

import pytest

from tests.helpers.bus_faults import EVENTS, campaign


@pytest.mark.usefixtures("without_type_checks")  # which take ten times as long as the playbacks
@pytest.mark.parametrize("seed", [0, 100_000])
def test_faults_drawn_at_random(seed):
    ends, wrong = campaign(seed, 50)
    assert [(at, found.event, found.wrong) for at, found in wrong] == []
    assert len({event for event, _ in ends}) > 0.8 * len(set(EVENTS))
    assert {result for _, result in ends} >= {"SUCCESS", "LINK_LOST", "SERVO_FAULT"}
