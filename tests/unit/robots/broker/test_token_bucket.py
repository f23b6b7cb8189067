"""How fast a user may go on."""

import math

from robots.broker.token_bucket import TokenBucket


def packets_in(bucket, seconds, cost=1.0, step=0.001):
    """How many packets a sender gets through that tries all the time."""
    done = 0
    for tick in range(int(seconds / step)):
        while not bucket.wait(tick * step):
            bucket.take(cost, tick * step)
            done += 1
    return done


def test_a_sender_gets_what_is_in_the_bucket_and_then_its_rate():
    assert abs(packets_in(TokenBucket(100.0, 50.0, 0.0), 10.0) - 1050) <= 2


def test_what_costs_more_than_is_there_is_done_and_paid_for_by_waiting():
    bucket = TokenBucket(100.0, 50.0, 0.0)
    bucket.take(250.0, 0.0)
    assert bucket.wait(0.0) == 2.01
    assert bucket.wait(0.0, least=8.0) == 2.08
    assert bucket.wait(2.0) > 0
    assert not bucket.wait(2.02)


def test_a_silent_sender_saves_no_more_than_the_bucket_holds():
    bucket = TokenBucket(100.0, 50.0, 0.0)
    packets_in(bucket, 1.0)
    assert not bucket.wait(1000.0)
    bucket.take(50.0, 1000.0)
    assert bucket.wait(1000.0) > 0


def test_without_a_rate_nobody_waits():
    bucket = TokenBucket(math.inf, math.inf, 0.0)
    bucket.take(1e9, 0.0)
    assert bucket.wait(0.0) == 0.0
