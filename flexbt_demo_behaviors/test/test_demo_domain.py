# SPDX-License-Identifier: BSD-3-Clause
"""A demonstration's own ROS domain."""

import os
import socket

import pytest

from flexbt_common.domains import (
    DISCOVERY_PORT,
    DISCOVERY_PORT_STEP,
    DOMAINS,
    NoFreeDomainError,
    own_domain,
)


@pytest.fixture(autouse=True)
def _no_domain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv('ROS_DOMAIN_ID', raising=False)


def test_the_domain_is_in_the_environment_only_for_the_context() -> None:
    with own_domain() as domain:
        assert os.environ['ROS_DOMAIN_ID'] == str(domain)
    assert 'ROS_DOMAIN_ID' not in os.environ


def test_two_demonstrations_get_different_domains(monkeypatch: pytest.MonkeyPatch) -> None:
    with own_domain() as first:
        monkeypatch.delenv('ROS_DOMAIN_ID')
        with own_domain() as second:
            assert first != second


def test_a_domain_that_is_held_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    with own_domain() as held:
        monkeypatch.delenv('ROS_DOMAIN_ID')
        with pytest.raises(NoFreeDomainError, match='ROS_DOMAIN_ID'), own_domain([held]):
            pass
        with own_domain([held, *DOMAINS]) as domain:
            assert domain != held


def test_a_domain_in_which_somebody_takes_part_is_passed_over() -> None:
    with own_domain() as free:
        pass
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        participant.bind(('', DISCOVERY_PORT + DISCOVERY_PORT_STEP * free))
        with pytest.raises(NoFreeDomainError), own_domain([free]):
            pass


def test_an_explicit_domain_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    with own_domain() as domain:
        assert domain == 7
    assert os.environ['ROS_DOMAIN_ID'] == '7'


def test_an_error_of_the_body_is_not_hidden() -> None:
    with pytest.raises(OSError, match='mine'), own_domain():
        raise OSError('mine')


@pytest.mark.parametrize('chosen', ['abc', '-1', '233'])
def test_what_is_no_domain_is_refused(chosen: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', chosen)
    with pytest.raises(NoFreeDomainError, match=f"'{chosen}'; it has to be a number"), own_domain():
        pass
