"""Which law a diagnosis takes, and which causes stay beside it."""

from types import SimpleNamespace as N

import numpy as np

from ehsa_ctrl.diagnosis.law import beside, fewer_terms, find, found, free_run, promising, tried
from ehsa_ctrl.diagnosis.law.judgement import is_beaten
from ehsa_ctrl.diagnosis.law.tried import laws_of_best, likely_forms
from ehsa_ctrl.diagnosis.model_selection import Reference, Selection
from ehsa_ctrl.diagnosis.pool import Pool
from ehsa_ctrl.diagnosis.scoring import ScoredHypothesis


def tried_law(place, base, deviance, gaps, without, deviance_without=7500.0, terms=1, windows=(None, None), wave=False):
    """What `laws_of_best` sees of a law in free run. gaps, without: on training and held-out data. windows: deviances
    in windows of both with the law, and without it.
    """

    def scored(deviance, gaps, in_windows):
        training, held_out = ({"speed": gap, "total": gap} for gap in gaps)
        return N(deviance=deviance, training_gap=training, held_out_gap=held_out, window_deviances=in_windows)

    law = N(
        scored=scored(deviance, gaps, windows[0]),
        stable=True,
        law=N(grammar=N(name=place), terms=range(terms), is_wave=wave),
    )
    beside = base.fit.candidates if base is not None else ()
    without = scored(deviance_without, without, windows[1])
    return N(law=law, base=base, without=without, terms=terms, beside=beside)


def test_effects_that_imitate_a_law_are_not_named_beside_it():
    """They leave as little on the training data as the law alone does, and more held-out gap."""
    plain, imitated = (0.02, 0.06), (0.003, 0.05)
    plant, effects = N(fit=N(candidates=())), N(fit=N(candidates=("rod_friction", "hose_wall")))
    alone = tried_law("pump_flow", plant, 5740.0, (0.002, 0.005), plain)
    other = tried_law("pump_flow", plant, 5800.0, (0.002, 0.006), plain)
    elsewhere = tried_law("force", plant, 5900.0, (0.002, 0.009), plain)
    worse = tried_law("force", plant, 5700.0, (0.0138, 0.009), plain)
    reference = Reference(5480.0, 16000.0, 0.02, 1.0, threshold=0.02)

    def best(deviance, gaps=(0.001, 0.005)):
        beside = tried_law("pump_flow", effects, deviance, gaps, imitated)
        return beside, laws_of_best([beside, elsewhere, other, alone, worse], beside.without, reference)

    assert best(5730.0)[1] == [alone, other]
    beside, found = best(5500.0)
    assert found == [beside]
    beside, found = best(5500.0, gaps=(0.0025, 0.005))
    assert found == [alone, other]


def test_a_law_replaces_effects_by_its_deviance_where_its_gaps_are_no_larger():
    """Single slips decide most of what both leave, but the deviance is lower by more than the margin."""
    effects = N(fit=N(candidates=("orifice_leakage", "chamber_volume_variation")))
    last = tried_law("pump_flow", effects, 650.0, (0.014, 0.016), (0.014, 0.016), 657.0).without

    def found(deviance, gaps):
        alone = tried_law("pump_flow", N(fit=N(candidates=())), deviance, gaps, (0.05, 0.056), 1800.0)
        return laws_of_best([alone], last, Reference(259.0, 1886.0, 0.05, 1.0)) == [alone]

    assert found(507.0, (0.0125, 0.0148))
    assert not found(607.0, (0.0125, 0.0148)) and found(607.0, (0.0125, 0.010))
    assert not found(507.0, (0.0125, 0.0165)) and not found(507.0, (0.025, 0.0148))


def test_slips_that_no_model_predicts_do_not_hide_a_law():
    """Its gaps are below the floor, or a little smaller than without it: the deviance tells. Above it, both do."""
    plant = N(fit=N(candidates=()))
    floors = {"speed": 0.032, "total": 0.032}, {"speed": 0.027, "total": 0.027}

    def found(deviance, gaps, without=(0.020, 0.029), floors=floors):
        alone = tried_law("torque", plant, deviance, gaps, without, 5546.0)
        return laws_of_best([alone], alone.without, Reference(3196.0, 11279.0, 0.05, 1.0, floors)) == [alone]

    assert found(3948.0, (0.017, 0.025))
    assert not found(3948.0, (0.017, 0.025), floors=({}, {}))
    assert not found(5000.0, (0.017, 0.025))
    # Half of the gap, but more of the deviance: a wrong law.
    assert found(3948.0, (0.025, 0.027), without=(0.047, 0.047), floors=({}, {}))
    assert not found(6000.0, (0.025, 0.027), without=(0.047, 0.047), floors=({}, {}))


def test_a_slip_in_the_held_out_data_does_not_hide_a_law_that_leaves_little():
    """A tenth of the deviance and a sixth of the training gap, but one stop later in the held-out data."""
    plant = N(fit=N(candidates=()))

    def found(deviance, gaps, before=6862.0):
        alone = tried_law("force", plant, deviance, gaps, (0.0393, 0.0543), before)
        return laws_of_best([alone], alone.without, Reference(1975.0, 16731.0, 0.07, 1.0)) == [alone]

    assert found(2485.0, (0.0066, 0.0402))
    assert not found(2485.0, (0.0066, 0.0550)) and not found(3230.0, (0.0066, 0.0402))
    assert not found(2485.0, (0.0300, 0.0402))
    # At noise a small share of the deviance says nothing.
    assert not found(1980.0, (0.0066, 0.0402), before=2020.0) and not found(1700.0, (0.0066, 0.0402), before=1970.0)


def test_a_wave_that_loses_its_phase_in_free_run_is_seen_in_windows():
    """Its gap on held-out data is no smaller than without it; over 2 s from measured states it is, on both segments."""
    plant = N(fit=N(candidates=()))

    def found(deviance, windows, gaps=(0.0415, 0.1289), wave=True):
        without = (0.0894, 0.1113), 18887.0
        windows = windows, (10366.0, 5701.0)
        alone = tried_law("displacement", plant, deviance, gaps, *without, windows=windows, wave=wave)
        return laws_of_best([alone], alone.without, Reference(1029.0, 22268.0, 0.09, 1.0)) == [alone]

    assert found(8948.0, (2606.0, 2896.0))
    assert not found(8948.0, (2606.0, 5400.0)) and not found(8948.0, (9800.0, 2896.0)) and not found(8948.0, None)
    # Windows alone are not enough: all of the training data in one run must fit better too, and where windows leave
    # half, no worse. A rig whose held-out gap the true plant does not close had such a wave.
    assert not found(14000.0, (2606.0, 2896.0))
    assert found(14000.0, (2606.0, 2800.0), gaps=(0.15, 0.1)) and not found(19000.0, (2606.0, 2800.0))
    assert found(18800.0, (2606.0, 2800.0), gaps=(0.15, 0.1))
    # What is no wave keeps its phase: steps of a drive close half of a gap where slips spoil the training data.
    assert not found(8948.0, (2606.0, 2896.0), wave=False)
    assert found(8948.0, (2606.0, 2896.0), gaps=(0.0850, 0.0550), wave=False)


def test_effects_that_leave_clearly_less_beat_a_law_unless_windows_say_otherwise():
    reference = Reference(19.0, 41607.0, 0.9, 0.7, threshold=0.03)

    def beaten(gaps, windows=None):
        law = tried_law("flow_2", None, 9000.0, (0.15, 0.63), gaps, 5000.0, windows=((300.0, 400.0), windows))
        return is_beaten(law.law.scored, law.without, reference)

    assert beaten((0.09, 0.36))
    assert not beaten((0.12, 0.36)) and not beaten((0.09, 0.5))
    assert not beaten((0.09, 0.36), windows=(700.0, 800.0))


def test_where_the_robust_loss_sees_noise_alone_the_gaps_tell():
    """A valve that opens for a few samples: both deviances are below that of noise, the law's a little lower."""
    plant = N(fit=N(candidates=()))

    def found(deviance, gaps):
        alone = tried_law("flows", plant, deviance, gaps, (0.184, 0.233), 2023.0)
        return laws_of_best([alone], alone.without, Reference(2179.0, 2045.0, 0.2, 1.0)) == [alone]

    assert found(1804.0, (0.001, 0.001))
    assert not found(1804.0, (0.001, 0.2)) and not found(2030.0, (0.001, 0.001))


def test_many_effects_may_leave_a_little_less_on_the_data_that_they_were_fitted_to():
    """Five effects with a brake of 0.03 N m: their numbers follow the training data, and the brake alone both parts."""
    effects = N(fit=N(candidates=("motor_friction", "torque_constant", "drive_dead_band")))
    last = tried_law("torque", effects, 3300.0, (0.0021, 0.0087), (0.0021, 0.0087), 3300.0).without

    def found(gaps):
        alone = tried_law("torque", N(fit=N(candidates=())), 3589.0, gaps, (0.0138, 0.0079), 5000.0)
        return laws_of_best([alone], last, Reference(2900.0, 8000.0, 0.055, 1.0)) == [alone]

    assert found((0.0031, 0.0031))
    assert not found((0.0031, 0.0065)) and not found((0.017, 0.0031))


def test_where_the_best_law_of_a_stretch_does_not_hold_on_all_data_that_of_another_place_is_tried(monkeypatch):
    """And no more than two places; a fit that can't be moved to the stretch has its laws searched on all data."""

    def law(place):
        return N(base="base", place=place, law=N(law=N(grammar=N(name=place))))

    tried, moved = [], N(scoring=N(objective="stretch"), reference=None)
    monkeypatch.setattr(find, "with_typical_priors", lambda data: data)
    monkeypatch.setattr(find, "fit_on", lambda objective, fit: fit)
    monkeypatch.setattr(find, "without_law", lambda *_: "without")
    monkeypatch.setattr(find, "laws_of_best", lambda found, *_: found[:1])
    monkeypatch.setattr(find, "refitted_to_all_data", lambda alike, *_: tried.append(alike[0]) or alike)
    hypotheses = N(fits={(): "nominal"}, pool=None)

    def found(places, holds):
        tried.clear()
        monkeypatch.setattr(find, "_search", lambda *_: ([law(one) for one in places], "last"))
        monkeypatch.setattr(
            find,
            "best_law",
            lambda laws, *_: next((n for one in laws if (n := one.law.law.grammar.name) in holds), None),
        )
        return find.find_law(hypotheses, None, N(scoring=None, reference=None), moved)

    assert found(["flow_1", "flow_1", "torque", "force"], {"torque"}) == "torque"
    assert [one.place for one in tried] == ["flow_1", "torque"]
    assert found(["flow_1", "torque", "force"], {"force"}) is None and found([], {"force"}) is None
    monkeypatch.setattr(find, "fit_on", lambda objective, fit: None)
    assert found(["force"], {"force"}) == "force" and not tried


def test_laws_that_are_far_off_as_found_are_not_refitted(monkeypatch):
    """The smallest gap comes first; a law whose run stops, or that leaves as much as asked or more, is left out. The
    gap is that of the scoring that is given."""
    gaps = {"near": 0.02, "stops": np.inf, "nearest": 0.01, "far": 0.06}
    monkeypatch.setattr(free_run, "gap_as_found", lambda law, scoring, _base: {"on the stretch": gaps}[scoring][law])

    assert free_run.screen_laws(list(gaps), "on the stretch", None, Pool(), 0.06) == ["nearest", "near"]
    assert free_run.screen_laws(list(gaps), "on the stretch", None, Pool(), np.inf) == ["nearest", "near", "far"]
    assert free_run.screen_laws([], "on the stretch", None, Pool(), 0.06) == []


def test_the_sum_that_explains_most_of_an_unknown_input_is_refitted(monkeypatch):
    """Although laws that hardly act leave less as they were found: steps of a drive left a quarter more than there was.
    One that explains little, or is far off, has no such place."""

    def law(name, place, explained):
        return N(name=name, grammar=N(name=place), families=(name,), explained=explained)

    idle = [law(f"idle {i}", f"flow_{i % 2}", 0.2) for i in range(4)]
    steps, less, far = law("steps", "torque", 0.73), law("less", "torque", 0.6), law("far", "torque", 0.9)
    gaps = {one.name: 0.024 + 1e-4 * i for i, one in enumerate(idle)} | {"steps": 0.031, "less": 0.03, "far": 0.9}
    monkeypatch.setattr(free_run, "gap_as_found", lambda one, *_: gaps[one.name])

    chosen = promising.promising([*idle, far, less, steps], None, None, 3, 0.048, Pool())

    assert [one.name for one in chosen] == ["idle 0", "idle 1", "idle 2", "steps"]
    chosen = promising.promising([steps, *idle[:2]], None, None, 3, 0.048, Pool())
    assert [one.name for one in chosen] == ["idle 0", "idle 1", "steps"]


def test_the_balance_decides_between_forms_that_a_free_run_hardly_tells_apart():
    """A form that explains the unknown input far better is not taken where its free run is worse by far."""
    reference = Reference(0.0, 2000.0, 0.1, 1.0)

    def form(name, deviance, evidence):
        return N(law=N(scored=N(deviance=deviance), file=N(form=name)), evidence=evidence)

    lag, hysteresis = form("lag", 360.0, -400.0), form("hysteresis", 650.0, 0.0)
    near = form("near", 365.0, -380.0)

    assert likely_forms([hysteresis, lag], reference) == [(lag, 1.0)]
    assert [one.law.file.form for one, _ in likely_forms([lag, near, hysteresis], reference)] == ["near"]
    # The better one of two refits that end at the same form.
    assert likely_forms([form("lag", 500.0, 0.0), lag], reference) == [(lag, 1.0)]


def test_an_effect_that_a_term_of_the_law_cancels_does_not_stay_beside_it(monkeypatch):
    """The law has a smaller deviance without it, and a larger one without the other effect."""
    delay, orifice = (N(key=(id, None), names=(id,)) for id in ("sensor_delay", "orifice_leakage"))
    deviances = {"orifice_leakage sensor_delay": 135.0, "sensor_delay": 125.0, "orifice_leakage": 304.0, "": 298.0}
    rest = {"total": 0.06}

    def law(members):
        ids = [name for one in members for name in one.names]
        found = tried_law("pump_flow", None, deviances[" ".join(ids)], (0.007, 0.01), (0.06, 0.11)).law
        found.scored.causes = tuple(one.key for one in members)
        return N(**vars(found), others=dict.fromkeys(ids), refitted=members, reduced=None, file=N(form="leakage"))

    def fit(members):
        return N(candidates=members, without=lambda out, _: tuple(c for c in members if c is not out))

    def refitted(laws, _scoring, base, *_, **__):
        return [law(base.candidates) for _ in laws]

    monkeypatch.setattr(beside, "refit", lambda _objective, members, values, *_, **__: fit(members))
    monkeypatch.setattr(beside, "refit_laws", refitted)
    scoring = N(
        objective=N(nominal=N(names=())),
        score=lambda one: N(fit=one, training_gap=rest, held_out_gap=rest, deviance=400.0),
    )
    both = (orifice, delay)
    first = tried.TriedLaw(
        law(both), tried.LawBase((), fit(both)), N(training_gap=rest, held_out_gap=rest, deviance=400.0), None, 0.0
    )

    found = beside.with_fewer_effects(
        [first],
        first.without,
        tried.LawData(lambda one: tried.LawBase((), one), scoring, Reference(0.0, 4000.0, 0.06, 1.0)),
        None,
    )

    best = laws_of_best(found, first.without, Reference(0.0, 4000.0, 0.06, 1.0))
    assert [one.base.fit.candidates for one in best] == [(delay,)]
    # Beside no effect, the law that was found beside the delay is tried, and the one found beside the orifice.
    assert [one.base.fit.candidates for one in found] == [both, (delay,), (orifice,), (), ()]


def sensor_error(setting, channel, decrease):
    """What `with_sensor_errors` sees of an error of a sensor, and what it promises."""
    name = f"{setting}.{channel}"
    candidate = N(effect=N(sensor=setting), key=(f"sensor_{setting}", channel), channel=channel, names=(name,))
    return N(candidate=candidate, decrease=decrease, start=lambda values: {**values, name: 1e-3})


def laws_beside_sensor_errors(monkeypatch, deviances, causes=(), imitators=None):
    """The names of the errors beside each law that is tried, and beside the best. deviances: by these names.
    imitators: what effects leave that the law must replace; by default the nominal plant.
    """
    gains = [sensor_error("delay", "speed", 40.0), sensor_error("filter", "p1", 6.0), sensor_error("delay", "p1", 5.9)]
    gains.append(sensor_error("bias", "p2", 0.5))
    rest = {"total": 0.06}

    def law(members):
        names = [name for one in members for name in one.names]
        found = tried_law("torque", None, deviances[" ".join(names)], (0.007, 0.01), (0.06, 0.11)).law
        found.scored.fit, found.scored.causes = N(residual=None, values={}, candidates=members), causes
        others = dict.fromkeys(names, 1e-3)
        return N(**vars(found), others=others, refitted=members, reduced=None, objective=None, file=N(form="brake"))

    def promised(fit):
        """One lag of a channel leaves nothing for another."""
        taken = [one.channel for one in fit.candidates]
        return [one for one in gains if one.candidate.channel not in taken]

    monkeypatch.setattr(beside, "screen", lambda *_: N(gains=promised))
    monkeypatch.setattr(beside, "likely_forms", lambda alike, _: [(one, 1.0) for one in alike])
    monkeypatch.setattr(beside, "refit", lambda _objective, members, values, *_, **__: N(candidates=members, values={}))
    monkeypatch.setattr(
        beside, "refit_laws", lambda laws, _scoring, base, *_, **__: [law(base.candidates) for _ in laws]
    )
    without = N(training_gap=rest, held_out_gap=rest, deviance=4000.0)
    scoring = N(objective=N(nominal=N(names=())), score=lambda _: without)
    first = tried.TriedLaw(law(()), tried.LawBase((), N(candidates=(), values={})), without, None, 0.0)
    others = [*(one.candidate for one in gains), N(effect=N(sensor=None))]
    reference = Reference(0.0, 4000.0, 0.06, 1.0)

    last = imitators or without
    found = beside.with_sensor_errors(
        [first], last, others, tried.LawData(lambda fit: tried.LawBase((), fit), scoring, reference), None
    )

    def names(one):
        return " ".join(name for c in one.base.fit.candidates for name in c.names)

    best = laws_of_best(found, last, reference)
    return [names(one) for one in found], names(best[0]) if best else None


def test_errors_of_sensors_that_are_no_causes_stay_beside_a_law_that_they_improve(monkeypatch):
    """That which promises most, and then one for each channel; a law needs no margin for them, and an offset that
    promises nothing is not tried."""
    speed, both = "delay.speed", "delay.speed filter.p1"
    tried_ones, best = laws_beside_sensor_errors(monkeypatch, {"": 300.0, speed: 290.0, both: 280.0})
    assert tried_ones == ["", speed, both] and best == both

    tried_ones, best = laws_beside_sensor_errors(monkeypatch, {"": 300.0, speed: 290.0, both: 310.0})
    assert best == speed and tried_ones == ["", speed, both, both]

    _, best = laws_beside_sensor_errors(monkeypatch, {"": 300.0, speed: 310.0, both: 320.0})
    assert best == ""


def test_a_law_that_effects_imitate_may_replace_them_once_it_has_the_errors_of_the_sensors_beside_it(monkeypatch):
    """Three effects leave less than the law alone. Where they still leave less, there is no law."""
    imitators = N(training_gap={"total": 0.005}, held_out_gap={"total": 0.0105}, deviance=250.0)
    deviances = {"": 300.0, "delay.speed": 290.0, "delay.speed filter.p1": 100.0}
    tried_ones, best = laws_beside_sensor_errors(monkeypatch, deviances, imitators=imitators)
    assert tried_ones[:3] == ["", "delay.speed", "delay.speed filter.p1"] and best == "delay.speed filter.p1"

    deviances = {"": 300.0, "delay.speed": 290.0, "delay.speed filter.p1": 280.0}
    assert laws_beside_sensor_errors(monkeypatch, deviances, imitators=imitators)[1] is None


def test_an_error_of_a_sensor_that_is_a_cause_is_not_put_beside_a_law(monkeypatch):
    """The selection would have to name it."""
    deviances = {"": 300.0, "delay.speed": 100.0, "delay.speed filter.p1": 100.0}
    tried_ones, best = laws_beside_sensor_errors(monkeypatch, deviances, causes=(("sensor_delay", "speed"),))
    assert tried_ones == [""] and best == ""


def test_each_term_of_a_law_must_lower_the_deviance_by_the_margin(monkeypatch):
    """Of three terms one tells nothing; without either of the others the law leaves much more."""
    deviances = {"abc": 300.0, "ab": 340.0, "ac": 900.0, "bc": 800.0, "a": 2000.0, "b": 2000.0}
    first, reference, law = laws_by_terms(monkeypatch, deviances)

    found = fewer_terms.with_fewer_terms(
        [first(law("abc"))], first(law("abc")).without, N(scoring=None, reference=reference), None
    )

    best = laws_of_best(found, found[0].without, reference)
    assert best[0].law.scored.deviance == 340.0
    assert sorted(one.law.scored.deviance for one in found) == [300.0, 340.0, 800.0, 900.0, 2000.0, 2000.0]


def test_what_the_closest_law_needs_may_be_the_best(monkeypatch):
    """Pressure and time with a second term are ahead by less than the margin of an exponential approach alone, which
    was tried; without that term they are ahead of both."""
    deviances = {"ab": 239.0, "e": 274.0, "a": 200.0, "b": 900.0}
    first, reference, law = laws_by_terms(monkeypatch, deviances)
    exponential, closest = first(law("e")), first(law("ab"))
    assert laws_of_best([exponential, closest], exponential.without, reference) == [exponential]

    found = fewer_terms.with_fewer_terms(
        [exponential, closest], exponential.without, N(scoring=None, reference=reference), None
    )

    assert laws_of_best(found, exponential.without, reference)[0].law.scored.deviance == 200.0
    # Each is refitted once.
    assert sorted(one.law.scored.deviance for one in found) == [200.0, 239.0, 274.0, 900.0]


def laws_by_terms(monkeypatch, deviances):
    """Laws of which each letter is a term; refitted, they have these deviances."""

    class Terms(str):
        families = property(tuple)

    def law(terms):
        found = tried_law("force", None, deviances[terms], (0.007, 0.01), (0.06, 0.11), terms=len(terms)).law
        fewer = [Terms(terms.replace(one, "")) for one in terms] if len(terms) > 1 else []
        return N(**vars(found), others={}, refitted=N(with_one_term_less=fewer))

    monkeypatch.setattr(fewer_terms, "refit_laws", lambda laws, *_: [law(terms) for terms in laws])
    rest = {"total": 0.06}
    base = tried.LawBase((), N(candidates=()))
    without = N(training_gap=rest, held_out_gap=rest, deviance=3000.0)
    return lambda one: tried.TriedLaw(one, base, without, None, 0.0), Reference(0.0, 4000.0, 0.06, 1.0), law


def test_a_law_found_beside_fewer_effects_is_tried_where_one_effect_is_left_out():
    """The best of each form for the same unknown input, which the refit keeps and whose effects lack that one."""
    leakage, delay = (N(key=(id, None)) for id in ("internal_leakage", "sensor_delay"))

    def tried(place, effects, deviance, form, stable=True):
        one = tried_law(place, N(fit=N(candidates=effects)), deviance, (0.01, 0.01), (0.06, 0.06))
        one.law.file, one.law.stable = N(form=form), stable
        return one

    best = tried("pump_flow", (delay, leakage), 271.0, "constant and time")
    growing = tried("pump_flow", (), 477.0, "time")
    others = [
        tried("pump_flow", (), 490.0, "time"),
        tried("pump_flow", (leakage,), 300.0, "other"),
        tried("torque", (), 200.0, "torque"),
        tried("pump_flow", (), 200.0, "vanishing", stable=False),
    ]

    assert beside.found_elsewhere([*others, growing, best], best, leakage) == [growing]


def selected(law_has, own=("sensor_delay", "K_T"), verdict="partly", left=0.2, terms=1, changed=("K_T",)):
    """What `without_imitators` makes of a selection with two effects and a nominal parameter. law_has: effects beside
    the law. own: what has a gap of its own in the hypothesis without the others. left: share of the deviance that the
    causes leave. terms: of the law. changed: what nominal parameters stand for that changed much beside it."""
    keys = {name: (name, None) for name in ("orifice_leakage", "sensor_delay", "K_T", "law")}
    effects = tuple(N(key=keys[name]) for name in ("orifice_leakage", "sensor_delay"))
    score = {"deviance": 1000.0 * left, "training_gap": {}, "held_out_gap": {}}
    causes = tuple(keys[name] for name in ("orifice_leakage", "sensor_delay", "K_T"))
    chosen = ScoredHypothesis(N(candidates=effects), own_gaps={}, causes=causes, **score)
    beside = tuple(one for one in effects if one.key[0] in law_has)
    without = ScoredHypothesis(N(candidates=beside), own_gaps={keys[n]: {} for n in own}, causes=(), **score)
    law = N(candidates=(*beside, N(key=keys["law"])), proposed=N(beside=tuple(law_has)), terms=terms, without=without)
    law.beside, law.changed = (tuple(keys[name] for name in some) for some in (law_has, changed))
    before = Selection(verdict, chosen, {}, {}, (), 0.0)
    return before, found.without_imitators(before, law, Reference(0.0, 1000.0, 0.05, 1.0))


def test_causes_stay_where_the_law_needs_all_effects_beside_it():
    """A nominal parameter is a cause that is no candidate: it is not left out."""
    before, after = selected(("orifice_leakage", "sensor_delay"))
    assert after is before


def test_a_nominal_parameter_that_made_up_for_the_law_is_no_cause_beside_it():
    """Its change vanishes where it is refitted with the law."""
    _, after = selected(("orifice_leakage", "sensor_delay"), own=("orifice_leakage", "K_T"), changed=())
    assert after.verdict == "partly" and after.chosen.causes == (("orifice_leakage", None),)
    _, after = selected(("orifice_leakage", "sensor_delay"), own=("K_T",), changed=())
    assert after.verdict == "outside_catalogue"


def test_causes_beside_a_law_are_those_of_the_hypothesis_without_the_imitators():
    """The nominal parameter stays; one whose change the smaller hypothesis does not need goes."""
    _, after = selected(("sensor_delay",))
    assert after.verdict == "partly" and after.chosen.causes == (("sensor_delay", None), ("K_T", None))
    assert [one.key[0] for one in after.chosen.fit.candidates] == ["sensor_delay"]
    _, after = selected(("sensor_delay",), own=("sensor_delay",))
    assert after.chosen.causes == (("sensor_delay", None),)


def test_nothing_is_named_where_the_law_needs_no_effect():
    """Nor an effect of which the law's refit changes the nominal value."""
    for changed in (("K_T",), ("orifice_leakage",)):
        _, after = selected((), own=("K_T",), changed=changed)
        assert after.verdict == "outside_catalogue" and not after.named


def test_causes_that_explained_the_gap_do_so_no_more_where_a_law_replaces_some():
    before, after = selected(("sensor_delay",), verdict="effect")
    assert before.explains and after.verdict == "partly" and after.named


def test_causes_that_leave_little_stay_unless_the_law_is_simpler():
    """Three causes: one term may stand for them, or for two of them, but neither for one nor two terms for three."""

    def stays(law_has, own, terms):
        before, after = selected(law_has, own=own, verdict="effect", left=0.02, terms=terms)
        return after is before

    assert not stays((), (), 1) and not stays(("sensor_delay",), ("sensor_delay",), 1)
    assert stays(("sensor_delay",), ("sensor_delay", "K_T"), 1) and stays((), (), 2)


def test_a_selection_that_names_nothing_stays():
    before, after = selected((), verdict="outside_catalogue")
    assert after is before


def test_a_law_is_sought_where_the_catalogue_leaves_much_of_the_deviance_or_needs_many_causes():
    """Of 1000 above noise; whatever is left, where the catalogue does not explain the gap."""
    reference = Reference(100.0, 1100.0, 0.05, 1.0)

    def sought(verdict, deviance, causes=(("hose_wall", None),)):
        return find.law_is_sought(Selection(verdict, N(deviance=deviance, causes=causes), {}, {}, (), 0.0), reference)

    assert all(sought(one, 300.0) and not sought(one, 150.0) for one in ("effect", "ambiguous", "underdetermined"))
    assert sought("outside_catalogue", 150.0) and sought("partly", 150.0) and not sought("underdetermined", 300.0, ())
    three = [(name, None) for name in ("sensor_bias", "asymmetric_friction", "relief_valve")]
    # What they leave above noise, 50 or 10, against the margin of 31 or 19.
    assert sought("effect", 150.0, three) and not sought("effect", 150.0, three[:2])
    assert not sought("effect", 110.0, three)


def test_a_law_takes_the_place_of_causes_that_the_log_can_t_tell_apart():
    """Too many alternatives to a set that imitates the law: the law alone, and nothing of the catalogue."""
    before, after = selected((), verdict="underdetermined")
    assert not before.named and before.has_causes and after.verdict == "outside_catalogue"
    before, after = selected(("orifice_leakage", "sensor_delay"), verdict="underdetermined")
    assert after is before
