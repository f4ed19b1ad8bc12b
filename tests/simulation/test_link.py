"""A loop over UDP on the loopback: the plant on one side, the controller on the other."""

import random
import socket
import struct
import threading
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
import pytest

from ehsa_ctrl import InputError, load_controller, load_plant, run_closed_loop, three_state
from ehsa_ctrl.core.watchdog import Watchdog
from ehsa_ctrl.simulation.link.controller_side import ControllerSide
from ehsa_ctrl.simulation.link.endpoint import Endpoint
from ehsa_ctrl.simulation.link.latency import EDGES, LatencyHistogram
from ehsa_ctrl.simulation.link.packet import CURRENT, END, READINGS, SAFE, Packet, decode
from ehsa_ctrl.simulation.link.plant_side import RemoteController
from ehsa_ctrl.simulation.sensors import Sensors

HERE = "127.0.0.1"
SAMPLES = 150
#: The layout that docs/how-to/serve.md states, written here a second time.
HEAD = "<4sBBHII"


@pytest.fixture(scope="module")
def plant():
    return load_plant("ehsa")


@pytest.fixture(scope="module")
def pid():
    return load_controller("pid_position", three_state(load_plant("ehsa", model="linear")))


def reference():
    rows = np.zeros((SAMPLES, 3))
    rows[10:, 0] = 0.02
    return rows


def loop_of(plant, controller, lag=0):
    return run_closed_loop(plant, controller, reference(), sensors=Sensors.of(plant, seed=3), lag=lag)


def same(one, other):
    np.testing.assert_array_equal(one.asked, other.asked)
    np.testing.assert_array_equal(one.measured, other.measured)
    np.testing.assert_array_equal(one.trajectory.states, other.trajectory.states)


def packed(kind, run, sequence, *numbers, version=1, magic=b"EHSA", flags=0):
    return struct.pack(HEAD, magic, version, kind, flags, run, sequence) + struct.pack(f"<{len(numbers)}d", *numbers)


@contextmanager
def serving(controller, watchdog=None, **options):
    """The controller's side in a thread; gives its port and a list that gets its summary or error."""
    side = ControllerSide(Endpoint.bound(READINGS, HERE), controller, watchdog or Watchdog(), **options)
    found = []

    def work():
        try:
            found.append(side.serve())
        except InputError as error:
            found.append(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    yield side.endpoint.port, found
    thread.join(60.0)
    assert not thread.is_alive()


@dataclass
class Relay:
    """Between both sides: loses, repeats and delays packets, and throws in some that are none."""

    port: int
    lose: float = 0.0
    repeat: float = 0.0
    swap: float = 0.0
    junk: float = 0.0
    front: socket.socket = field(default_factory=lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    back: socket.socket = field(default_factory=lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    stopping: bool = False

    def __enter__(self):
        self.dice, self.peer, self.kept = random.Random(1), None, {}
        for one in (self.front, self.back):
            one.bind((HERE, 0))
            one.settimeout(0.002)
        self.thread = threading.Thread(target=self.work, daemon=True)
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.stopping = True
        self.thread.join(5.0)
        self.front.close()
        self.back.close()

    def work(self):
        idle = False
        while not (self.stopping and idle):  # the plant's END is still forwarded
            idle = True
            for source in (self.front, self.back):
                try:
                    data, sender = source.recvfrom(500)
                except TimeoutError:
                    continue
                idle = False
                if source is self.front:
                    self.peer = sender
                    self.forward(self.back, data, (HERE, self.port))
                else:
                    self.forward(self.front, data, self.peer)

    def forward(self, out, data, to):
        if data[5] == END:
            out.sendto(data, to)
            return
        if self.dice.random() < self.junk:
            out.sendto(self.dice.choice([b"", b"hello", data[:-1], data + b"!", b"X" + data[1:]]), to)
        if self.dice.random() < self.lose:
            return
        if self.dice.random() < self.swap:
            self.kept[out] = data
            return
        for _ in range(2 if self.dice.random() < self.repeat else 1):
            out.sendto(data, to)
        if out in self.kept:
            out.sendto(self.kept.pop(out), to)


@pytest.mark.parametrize("lag", [0, 2])
def test_lock_step_is_the_direct_run_to_the_bit(plant, pid, lag):
    """Readings and currents pass as the doubles they are; every sample gets its own answer."""
    with serving(pid) as (port, found):
        remote = RemoteController.connected(HERE, port, plant.sample_time, plant.watchdog)
        apart = loop_of(plant, remote, lag)
        summary = remote.finish()

    same(apart, loop_of(plant, pid, lag))
    assert (summary.samples, summary.missed, summary.tripped, summary.packets.lost) == (SAMPLES, 0, "", 0)
    assert found[0].ended == "the plant's side ended the run" and found[0].samples == SAMPLES
    assert all(one.latencies[0].counts.sum() >= SAMPLES for one in (summary, found[0]))


def test_lock_step_survives_a_bad_network_to_the_bit(plant, pid):
    """Lost, repeated, swapped and malformed packets cost time, not correctness, and are counted."""
    with (
        serving(pid) as (port, found),
        Relay(port, lose=0.05, repeat=0.2, swap=0.05, junk=0.2) as relay,
    ):
        remote = RemoteController.connected(HERE, relay.front.getsockname()[1], plant.sample_time, plant.watchdog)
        apart = loop_of(plant, remote)
        summary = remote.finish()

    same(apart, loop_of(plant, pid))
    mine, theirs = summary.packets, found[0].packets
    assert mine.resent > 3 and mine.repeated > 5 and mine.malformed > 5
    assert theirs.repeated > 5 and theirs.malformed > 5 and theirs.lost == 0
    assert "expected" in mine.first_malformed
    assert summary.missed == found[0].missed == 0


def test_in_real_time_the_samples_keep_their_period(plant, pid):
    """A sample every 2 ms of the clock, and the loop regulates: the rod has moved towards the target."""
    with serving(pid) as (port, _):
        remote = RemoteController.connected(HERE, port, plant.sample_time, plant.watchdog, period=0.002)
        apart = loop_of(plant, remote)
        summary = remote.finish()
    lateness = summary.latencies[1].times

    assert lateness.size == SAMPLES - 1 and np.median(lateness) < 0.002
    if not summary.tripped:  # on a machine that is too busy the watchdog is right to act
        assert apart.trajectory["x"][-1] > 0.01


def test_a_plant_that_hears_nothing_more_goes_to_its_safe_current(plant, pid):
    """The last current is held for the time-out, then the safe one acts for good; the reason names the sample."""

    class Leaving:
        """A controller's side that answers 40 samples."""

        def __init__(self):
            self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self.socket.bind((HERE, 0))
            self.thread = threading.Thread(target=self.work, daemon=True)
            self.thread.start()

        def work(self):
            for _ in range(40):
                data, sender = self.socket.recvfrom(500)
                *_, run, sequence = struct.unpack_from(HEAD, data)
                self.socket.sendto(packed(CURRENT, run, sequence, 1.5), sender)

    other = Leaving()
    watchdog = Watchdog.model_validate({"timeout": 0.02, "safe_current": -0.25}, context={"si": True})
    port = other.socket.getsockname()[1]
    remote = RemoteController.connected(HERE, port, plant.sample_time, watchdog, period=0.005)
    loop = loop_of(plant, remote)
    summary = remote.finish()
    other.thread.join(5.0)
    other.socket.close()
    answered = int(np.flatnonzero(loop.asked == -0.25)[0])

    assert np.all(loop.asked[:answered] == 1.5) and np.all(loop.asked[answered:] == -0.25)
    assert answered >= 40 + 4  # five samples of 4 ms are the 20 ms of the time-out
    assert summary.tripped.startswith("no answer in time for 5 samples; -0.25 A from sample ")
    assert summary.missed >= SAMPLES - 40 and summary.packets.lost == summary.missed - summary.packets.late


def exchange(port, *packets):
    """Send datagrams to the controller's side, one after the other; gives the answers that come."""
    rig = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    rig.settimeout(1.0)
    answers = []
    for data in packets:
        rig.sendto(data, (HERE, port))
        try:
            answers.append(decode(rig.recv(500)))
        except TimeoutError:
            answers.append(None)
    rig.close()
    return answers


def test_the_controllers_side_counts_what_a_rig_sends(pid):
    """A repeated packet gets the same answer, a gap runs the controller with lost readings, an old one is ignored."""
    numbers = (0.0, 2e6, 2e6, 0.001, 0.0, 0.02, 0.0, 0.0, 0.0)
    packets = [packed(READINGS, 7, k, *numbers) for k in range(6)]
    with serving(pid, patience=20.0) as (port, found):
        answers = exchange(
            port, packets[0], packets[1], packets[1], packets[4], packets[2], packets[5], packed(END, 7, 6)
        )
    memory, lost = pid.initial_memory(), np.full(5, np.nan)
    wanted = np.array([0.02, 0.0, 0.0, 0.0])
    mine = [pid.step(wanted, lost if k in (2, 3) else np.array(numbers[:5]), memory) for k in range(6)]

    assert [answer and answer.sequence for answer in answers[:6]] == [0, 1, 1, 4, None, 5]
    assert [answers[k].numbers[0] for k in (0, 1, 2, 3, 5)] == [mine[0], mine[1], mine[1], mine[4], mine[5]]
    counts = found[0].packets
    assert (counts.repeated, counts.late, counts.lost, found[0].missed) == (1, 1, 1, 2)


def test_too_long_a_gap_ends_in_the_safe_current(pid):
    """More samples are missing than the time-out allows: the answer is the safe current and says so, for good."""
    numbers = (0.0, 2e6, 2e6, 0.001, 0.0, 0.02, 0.0, 0.0, 0.0)
    watchdog = Watchdog.model_validate({"timeout": 0.04, "safe_current": 0.5}, context={"si": True})
    with serving(pid, watchdog, patience=20.0) as (port, found):
        sent = [packed(READINGS, 7, k, *numbers) for k in (0, 2**32 - 2, 2**32 - 1)]
        answers = exchange(port, *sent, packed(END, 7, 0))

    assert not answers[0].safe and answers[1].safe and answers[2].safe
    assert answers[1].numbers == answers[2].numbers == (0.5,)
    assert "samples without readings; 0.5 A from sample 1 on" in found[0].tripped


def test_silence_in_real_time_is_answered_by_the_safe_current_unasked(pid):
    """The rig stops sending: after the time-out it gets the safe current once, flagged."""
    with serving(pid, period=0.004, patience=1.5) as (port, found):
        first, unasked = exchange(port, packed(READINGS, 7, 0, *np.zeros(9)), b"")

    assert not first.safe and unasked.flags == SAFE and unasked.numbers == (0.0,)
    assert found[0].tripped.startswith("no readings for 40 ms") and found[0].ended == "no packet for 1.5 s"


def test_readings_without_a_reference_need_one_on_this_side(pid):
    """nan in the packet means that the rig has none."""
    with serving(pid) as (port, found):
        exchange(port, packed(READINGS, 7, 0, *np.zeros(5), *np.full(4, np.nan)))

    assert str(found[0]) == (
        "sample 0: the readings come without a reference (nan); give one on this side with --scenario"
    )


WRONG = {
    b"": "0 bytes; expected a header of 16 bytes",
    packed(CURRENT, 1, 2, 0.5, magic=b"ASHE"): "begins with b'ASHE'; expected b'EHSA'",
    packed(CURRENT, 1, 2, 0.5, version=2): "version 2; expected version 1",
    packed(9, 1, 2): "kind 9; expected 1 (READINGS), 2 (CURRENT), 3 (END)",
    packed(CURRENT, 1, 2): "a CURRENT packet of 16 bytes; expected 24",
    packed(READINGS, 1, 2, *range(10)): "a READINGS packet of 96 bytes; expected 88",
    packed(CURRENT, 1, 2, float("nan")): "a current of nan; expected a finite number",
}


@pytest.mark.parametrize("data", WRONG)
def test_what_is_no_packet_is_a_sentence(data):
    with pytest.raises(InputError) as caught:
        decode(data)

    assert str(caught.value) == WRONG[data]


def test_the_layout_is_the_documented_one():
    """Bytes written by hand against those of the package, in both directions."""
    numbers = (1.5, float("-inf"), -0.0, 5e-324, 1e300, 0.02, 0.1, 1.0, -2.0)
    data = packed(READINGS, 0xDEADBEEF, 42, *numbers, flags=SAFE)

    assert decode(data) == Packet(READINGS, 0xDEADBEEF, 42, numbers, SAFE)
    assert Packet(READINGS, 0xDEADBEEF, 42, numbers, SAFE).encode() == data
    assert data[:8] == b"EHSA\x01\x01\x01\x00" and len(data) == 88


def test_a_histogram_counts_every_time_once():
    """An edge belongs to the bin that it opens; times beyond the edges count too."""
    times = np.array([1e-7, 1e-6, 1.5e-6, 2e-6, 0.03, 7.0])
    counts = LatencyHistogram("any", times).counts

    assert counts.sum() == 6 and counts.size == EDGES.size + 1
    assert (counts[0], counts[1], counts[2], counts[-1]) == (1, 2, 1, 1)
    assert "nothing measured" in str(LatencyHistogram("none", np.zeros(0)))


def test_a_taken_port_and_silence_are_sentences(plant, pid):
    with serving(pid, patience=0.2) as (port, found), pytest.raises(InputError, match="can't listen there"):
        Endpoint.bound(READINGS, HERE, port)
    assert "no readings within 0.2 s; start the plant's side" in str(found[0])

    remote = RemoteController.connected(HERE, port, plant.sample_time, plant.watchdog, patience=0.2)
    with pytest.raises(InputError, match=r"no answer within 0\.2 s; start the controller's side"):
        loop_of(plant, remote)
    remote.finish()
