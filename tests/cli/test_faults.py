"""Faulty configurations of every command: one line with file, table, key, value and rule."""

import pytest

from jaxpound.cli.files import example
from tests.cli.commands import changed, command_for, faults, refusal

FAULTS = {}
FAULTS["simulate"] = r'''
period -> perod = 0.9 => [building_1] has an unknown key 'perod'; did you mean 'period'?
[damper] -> [dampr] => unknown key 'dampr'; did you mean 'damper'?
gap -> colour = 1 => the top level has an unknown key 'colour'; allowed are gap, building_1
[damper] ; gap = 1 => unknown key 'gap'; it belongs in the top level
mass = = 1 => :18: mass = = 1: Invalid value (at line 18, column 8)
mass = 500,5 => column 11); a decimal point, not a comma: 0.1
period = .9 => column 10); a number begins with a digit: 0.1, not .1
period = 1. => column 11); a digit follows the point: 1.0, not 1.
gap = 0.1.2 => gap = 0.1.2: Expected newline or end of document
[damper] -> [damper => Expected ']'
[output] -> [damper] => Cannot declare ('damper',) twice
series = [ => Invalid value (at end of document)
gap = """ => Unterminated string
mass = "5" => [building_1] mass = "5" must be a finite number
mass = true => [building_1] mass = true must be a finite number
mass = nan => [building_1] mass = nan must be a finite number
mass = -5 => [building_1] mass = -5 kg must be between 0.001 and 1e+10 kg (
period -> nothing => [building_1] lacks period; give mass, period
# tau_f -> stiffness = 1e6 => [building_1] must not have stiffness
order = 1.5 => [building_1] order = 1.5 must be between 0.001 and 1 (
damping_ratio = 0.9 => [building_1] damping_ratio = 0.9 must be below
gap = -0.1 => gap = -0.1 m must be between 0 and 10 m (
gap -> nothing => lacks gap; give gap, building_1, building_2, damper (contact)
friction_force -> nothing => [damper] lacks the key 'friction_force'
friction_force -> nothing & [damper] -> nothing => lacks damper; give gap, building_1
friction_force = -1 => [damper] friction_force = -1 N must be between 0 and 1e+10 N (
pga = 0.3 => [ground] must have scale or pga, not both
scale = 0 => [ground] scale = 0 must not be 0: nothing would shake
scale -> pga = 0 => [ground] pga = 0 g must be between 1e-06 and 20 g (
scale = 100 => record: PGA = 39.78 g must be at most 20 g: is [ground] pga or scale right?
baseline = "cubic" => "linear", "mean", "none"
friction = "smoothed" => [run] smoothing_velocity must be given
smoothing_velocity = 1e-3 => [run] smoothing_velocity must be given
friction = "smoothed" & smoothing_velocity = -1
    => [run] smoothing_velocity = -1 m/s must be between 1e-09 and 1 m/s (
order = 2 -> order = 3 => [run] order = 3 must be from 1 to 2
order = 2 -> order = 1.5 => [run] order = 1.5 must be a whole number
order = 2 -> order = true => [run] order = true must be a whole number
order = 2 -> order = [2] => [run] order = [2] must be a whole number
order = 2 -> order = "2" => [run] order = "2" must be a whole number
order = 2 -> order = inf => [run] order = inf must be a whole number
dt = 0.5 => [run] dt = 0.5 s must be positive and below the stability limit
dt = 0 => [run] dt = 0 s must be between 1e-07 and 10 s (
dt = 0.05 => [run] dt = 0.05 s must be at most the record's, 0.02 s
duration = 1e9 => [run] duration = 1e+09 s must be between
duration = 0.01 => [run] duration = 0.01 s must be between
period = 9e-4 => period = 0.0009 s must be between 0.002 and 60 s (models
period = 900 => [building_1] period = 900 s must be between 0.002 and 60 s
period -> stiffness = 1e14 ; tau_f = 1e-3 ; tau_x = 2e-3 ; order = 0.5 & damping -> nothing
    => [building_1] natural period = 0.000
friction_force = 1e300 => friction_force = 1e+300 N must be between
scale = 1e44 => [ground] scale = 1e+44 must be between -1000 and 1000
baseline = "liner" => "none"; did you mean 'linear'?
[contact] ; restitution = 0.6 => [contact] lacks the key 'law'
[contact] ; law = "neuton" ; restitution = 0.6 => [contact] law = "neuton" must be one of
    "hertz", "hertz-damped", "jankowski", "kelvin-voigt", "newton"; did you mean 'newton'?
[contact] ; law = "newton" ; restitution = 1.5
    => [contact] restitution = 1.5 must be between 0.001 and 1 (
[contact] ; law = "newton" ; restitution = 0.0 => [contact] restitution = 0.0 must be between 0.001
[contact] ; law = "newton" ; restituton = 0.6
    => [contact] has an unknown key 'restituton'; did you mean 'res
[contact] ; law = "newton" => [contact] lacks the key 'restitution', which law = "newton" needs
[contact] ; law = "newton" ; restitution = 0.6 ; stiffness = 1e9
    => [contact] stiffness must not be given with law = "newton"; give restitution
[contact] ; law = "hertz" ; stiffness = 0
    => [contact] stiffness = 0 must be between 0.001 and 1e+20 (N/m,
[contact] ; law = "hertz" ; stiffness = 1e9 ; restitution = 0.6
    => [contact] restitution must not be given with law = "hertz"; give stiffness
[contact] ; law = "kelvin-voigt" ; stiffness = 1e9 ; restitution = 0.6 ; tension = 1
    => [contact] tension = 1 must be true or false
[contact] ; law = "hertz-damped" ; stiffness = 1e9 ; restitution = 0.6 ; damping = "exakt" =>
    [contact] damping = "exakt" must be one of "exact", "hunt-crossley", "muthukumar", "ye"; did you
    mean 'exact'?
[contact] ; law = "jankowski" ; stiffness = 1e9 ; restitution = 0.6 ; damping = "exact"
    => [contact] damping must not be given with law = "jankowski"; give stiffness, restitution
series = "hdf5" => [output] series = "hdf5" must be one of
'''
FAULTS["montecarlo"] = r"""
wavelets -> wavelet = 4 => has an unknown key 'wavelet'; did you mean 'wavelets'
wavelets -> nothing => [earthquakes] lacks wavelets; give wavelets, amplitude, periods
wavelets = 0 => [earthquakes] wavelets = 0 must be from 1 to 2147483648
wavelets = 1_000_000_000
    => [earthquakes] wavelets = 1,000,000,000 would take 88 TB of memory; this machine has
amplitude = 0.3 => [earthquakes] amplitude = 0.3 must be {normal = [mean
amplitude = {beta = [1, 2]} => must be {normal = [mean, std]}, {logn
amplitude = {normal = [1]} => must be {normal = [mean, std]}, {logn
periods = {uniform = [2, 1]} => [earthquakes] periods: high = 1 must be finite and above low = 2
amplitude = {uniform = [0.04, 0.01]} => [earthquakes] amplitude: high = 0.01 must be finite and
amplitude = {lognormal = [-0.04, 0.2]} => [earthquakes] amplitude: median = -0.04 must be positive
amplitude = {unifrom = [1, 2]} => did you mean 'uniform'?
amplitude = {uniform = [0, nan]} => ; uniform = [0, nan] must be two finite numbers
friction = {uniform = [2, 1]} => [uncertain] friction: high = 1 must be finite and above low = 2
"rod_1.tau_x" = {normal = [0.01, 1e-4]}
    => [uncertain] rod_1.tau_x ~ Normal(mean=0.00064
friction_force = 0 => [uncertain] friction must be of a value above
negative = 2.0 => [earthquakes] negative = 2.0 must be between 0 and 1
wavelets -> records = ["a"] => [earthquakes] must not have records here; give wavelets
wavelets = 4 ; units = 'g' => must not have units here; give wavelets
negative -> records = [] => [earthquakes] records = [] must be a list of paths or {file = ...}
friction = { -> frictoin = {uniform = [1, 2]} => has an unknown key 'frictoin'; did you mean
duration -> nothing => [run] lacks the key 'duration'
duration = 0.001 => [run] duration = 0.001 s must be between 2 and
dt = 5.0 => [run] dt = 5 s must be positive and below the stability limit
samples = 0 => [study] samples = 0 must be from 1 to
sampling = "halton" => [study] sampling = "halton" must be one of "plain", "sobol"
periods = {uniform = [1e-6, 2e-6]} => [earthquakes] periods = {uniform = [1e-06, 2e-06]} reaches
    1e-06 s; it must stay between 0.001 and 60 s
periods = {uniform = [-2, -1]} => reaches -2 s; it must stay between 0.001
periods = {normal = [1.0, 0.3]}
    => [earthquakes] periods = {normal = [1, 0.3]} reaches -0.426 s once in
arrivals = {uniform = [20, 30]} => [earthquakes] arrivals = {uniform = [20, 30]} reaches 20 s;
    it must stay between 0 and 12 s (the run
arrivals = {uniform = [-1, 2]} => reaches -1 s; it must stay between 0
intensity = {hazard = [[0.1, 1e-3], [0.2, 2e-3]]}
    => [earthquakes] intensity: annual_rate = 0.002 (at index [1]) must be no larger than
intensity = {hazard = [[0.1, 1e-3], [0.2, 9e-4]]}
    => [earthquakes] intensity = {hazard = [[0.1, 0.001], [0.2, 0.0009]]} reaches 2.
intensity = {lognormal = [1.0, 21.0]}
    => [earthquakes] intensity = {lognormal = [1, 21]} reaches 2.25e+43 once in
intensity = {normal = [1.0, 0.5]} => reaches -1.377 once in 1,000,000
amplitude = {uniform = [10, 40]} => reaches 40 m; it must stay between
friction = {lognormal = [1.0, 100]} => [uncertain] friction = {lognormal = [1, 100]} reaches
    2.745e+206 once in 1,000,000 draws; it must stay between 0 and 1000
friction = {normal = [0, 1]} => [uncertain] friction = {normal = [0, 1]} reaches -4.753 once in
stiffness_ratio -> mass_ratio = {lognormal = [1e-7, 0.1]} => [uncertain] mass_ratio = {lognormal
    = [10000000, 0.1]} reaches 6.217e+06 once in 1,000,000 draws; it must stay between 0 and 1000
stiffness_ratio -> mass_ratio = {normal = [1.0, 0.1]} => [uncertain] mass_ratio = {normal = [1,
    0.1]} must be lognormal; building.2.floor.1.mass takes any factor
stiffness_ratio -> "link.1.friction_force" = {lognormal = [1.0, 0.1]}
    => [uncertain] friction and link.1.friction_force must not stand for the same parameter
stiffness_ratio = {uniform = [1.0, 1e6]}
    => [uncertain] stiffness_ratio = {uniform = [1, 1000000]} reaches 1e+06; it must stay between 0
[contact] ; law = 'newton' ; restitution = 0.65 & stiffness_ratio -> contact.stiffness =
    {uniform = [0.5, 2.0]} => [uncertain] has an unknown key 'contact.stiffness'; did you mean
stiffness_ratio -> "contact.stiffness" = {uniform = [0.5, 2.0]} => [uncertain] contact.stiffness
    must be a parameter of link.1: friction_force, gap
[contact] ; law = 'newton' ; restitution = 0.65 & stiffness_ratio -> contact.restitutoin =
    {uniform = [0.5, 2.0]} => [uncertain] has an unknown key 'contact
"""
FAULTS["design"] = r"""
friction = { -> fricton = {low = 0.0, high = 5.0} => did you mean 'friction'
friction = [0, 5] => [variables] friction = [0, 5] must be {low
friction = {low = 5.0, high = 1.0}
    => scale = "linear" or "log"}; high = 1 must be finite and above low = 5
seed = 4294967296 => [search] seed = 4294967296 must be from 0 to 4294967295
batch = 6400 => [search] batch = 6400 must be at most the ensemble's 256
[variables] -> [recorded] ; files = [] ; [variables] => [recorded] files = [] must be
friction = {low = 2.0, high = 5.0}
    => scale = "linear" or "log"}; low and high must hold the factor 1
friction = {low = 0.0, high = 1e6}
    => high = 1000000 must be between 0 and 1000 (a factor on the value
friction = {low = 0.0, hihg = 5.0} => did you mean 'high'?
"rod_1.tau_f" = {low = 0.5, high = 1000} => [variables] rod_1.tau_f = 3.7846988, as
    large as it may be, must be below tau_x = 0.32098712
friction = { -> mass_ratio = {low = 0.0, high = 2.0} => [variables] mass_ratio = {low = 0, high = 2,
    scale = "linear"} must have low above 0; building.2.floor.1.mass takes any factor
goal = "gap" => [objective] goal = "gap" must be one of
goal = "men gap" => did you mean 'mean gap'?
share = 0.1 => [objective] share must not be given with goal
goal = "soft minimum" => [objective] lacks the key 'temperature'
goal = "least demand" => [objective] lacks the key 'demand'
demand = "peak_x1" => [objective] demand must not be given with goal =
goal = "least demand" & demand = "peak_x3"
    => objective: 'peak_x3' in goal must be one of
goal = "least demand" & demand = "peak_drft"
    => [objective] unknown demand 'peak_drft'; did you mean 'peak_drift'?
goal = "least demand" & demand = "peak_contact"
    => objective: 'peak_contact' in goal must be of structures with a contact law
goal = "CVaR" & share = 1.0 => share = 1 must be between 0 and 1
goal = "CVaR" & share = 2.0 => [objective] share = 2.0 must be between 1e-06 and 1 (of the
peak_f1 -> peak_f3 = 1.0 => objective: 'peak_f3' in limits must be one of
peak_f1 = -1.0 => [limits] peak_f1 = -1 N must be between 1e-06 and 1e+12 N
peak_f1 = {at_most = 1.0, over = "x"} => peak_f1: over = 'x' must be
peak_f1 -> required_gap = 0.1 => [objective] limits: required_gap = 0.1 must have a probability
goal = "gap at rest" => [objective] goal = "gap at rest" must be given with a
earthquakes = 1000000000 => [search] earthquakes: n = 1,000,000,000 would take
peak_f1 -> required_gap = {probability = 2.0} => probability = 2.0 must be between 1e-12 and 0.5
peak_f1 = {probability = 1e-3} => [objective] limits: peak_f1: at_most = None must be given
peak_f1 -> peak_contact = 1e6 => 'peak_contact' in limits must be of structures with a contact law
[contact] ; law = 'newton' ; restitution = 0.65 & peak_f1 -> peak_contact = 1e6 => objective:
    'peak_contact' in limits must not be by Newton's law, whose impacts have none; peak_impulse is
[contact] ; law = 'newton' ; restitution = 0.65 & goal = "pounding probability"
    => objective: PoundingProbability must be of structures without a law of contact
[contact] ; law = 'newton' ; restitution = 0.65 & friction = { -> contact.restitution = {low =
    0.5, high = 2.0} => [variables] contact.restitution: high = 1.3 must be at most 1
starts = 0 => [search] starts = 0 must be from 1 to
earthquakes = 0 => [search] earthquakes = 0 must be from 1 to
"""
FAULTS["rare"] = r"""
frequency -> nothing => [earthquakes] lacks frequency; give filter, frequency, damping
frequency = 900 => [earthquakes] frequency = 900 Hz must be between
filter -> nothing => [earthquakes] lacks filter; give filter, frequency, damping
filter = "kanai" => [earthquakes] filter = "kanai" must be one of
high_pass = 1 => [earthquakes] high_pass must be given with filter
acceleration = 20 => [earthquakes] acceleration = 20 g must be betw
acceleration = {normal = [0.1, 0.1]}
    => [earthquakes] acceleration = {normal = [0.1, 0.1]} reaches -0.37
acceleration = "g" => [earthquakes] acceleration = "g" must be a st
acceleration -> wavelets = 4 => [earthquakes] must not have wavelets here; give wavelets
envelope = {peak = 3.0} => [earthquakes] envelope lacks power; give peak, power
envelope = {rise = 4.0, end = 2.0, decay = 1.0}
    => [earthquakes] envelope end = 2 must be finite and above rise = 4
# gap = -> gap = -1 => [limit] gap = -1 m must be between 1e-09 and 10 m
threshold = 1 => [limit] lacks demand; give demand, threshold
demand = "peak_x1" => [limit] lacks threshold; give demand, threshold
demand = "peak_y" ; threshold = 1 => [limit] unknown demand 'peak_y'
thresholds = [0.1, -0.1] => [limit] thresholds = -0.1 m must be between 1e-09
# gap = -> gap = 150 => [limit] gap = 150 m must be between 1e-09 and 10 m
demand = "peak_x1" ; threshold = 0 => [limit] threshold = 0 m must be between 1e-09
demand = "peak_x1" ; threshold = 1e300 => [limit] threshold = 1e+300 m must be between
acceleration = 0 => [earthquakes] acceleration = 0 g must be between
cov = 2 => [search] cov = 2 must be between 0.001 and 0.99
method = "form" => [search] method = "form" must be one of "auto"
[design] ; probability = 0.1 ; parameter = "fiction"
    => [design] parameter: has an unknown key 'fiction'; did you mean 'friction'
[design] ; parameter = "friction" ; probability = 2
    => [design] probability = 2 must be between 1e-12 and 0.5
# dt = 0.01 -> dt = 2.0 => [run] dt = 2
dt = 0.4 => [earthquakes] dt = 0.4 s must be at most half of the soil's period, 0.3333 s
demand = "peak_contact" ; threshold = 1
    => [limit] demand = 'peak_contact' must be of structures with a contact law
"""
FAULTS["montecarlo_row"] = r"""
"link.2 -> "link.1.friction_force" = {uniform = [1, 2]} => must be of a value above 0
"link.2 -> "link.2.gap" = {uniform = [1, 2]}
    => [uncertain] link.2.gap must be a parameter of link.2: friction_force
"link.2 -> "link.*.contact.stiffness" = {uniform = [1, 2]}
    => link.*.contact.stiffness must be a parameter of link.*: friction_force, gap
gap = 0.05 ; contact = {law = "newton", restitution = 0.65} & "link.2 ->
    "link.1.contact.stiffness" = {uniform = [1, 2]} => 'link.1.contact.stiffness'; did you mean
"link.2 -> "link.3.gap" = {uniform = [1, 2]} => [uncertain] link.3.gap must be of a
"link.2 -> "building.1.storey.3.stiffness" = {uniform = [1, 2]}
    => [uncertain] building.1.storey.3.stiffness must be of a building, floor, storey or
"link.2 -> "building.*.storey.*.stifness" = {uniform = [1, 2]}
    => 'building.*.storey.*.stifness'; did you mean 'building.*.storey.*.stiffness'
"link.2 -> "building.2.storey.*.tau_f" = {uniform = [1, 900]}
    => [uncertain] building.2.storey.1.tau_f ~ Uniform
"link.2 -> "friction" = {uniform = [1, 2]} => has an unknown key 'friction'
"link.2 -> "building.2.storey.*.stiffness" = {uniform = [1, 2]}
    => building.*.storey.*.stiffness and building.2.storey.*.stiffness must not stand for
"building.*.floor.*.mass" = {uniform = [1, 1e5]}
    => building.*.floor.*.mass = {uniform = [1, 100000]} reaches 1e+05; it must stay between 0 and
correlation = 1.5 => [study] correlation = 1.5 must be between
correlation = -0.9 => [uncertain] correlation = -0.9 must be
"""
FAULTS["design_row"] = r"""
total_damper_force = -1.0 => [limits] total_damper_force = -1 N must be
total_damper -> total_damper_forc = 1.0 => did you mean 'total_damper_force'?
total_damper -> peak_x6 = 1.0 => objective: 'peak_x6' in limits must be one of
"link.* -> "link.9.friction_force" = {low = 0, high = 2} => [variables] link.9.frict
"""

LONG = {
    f"mass = 1{'0' * 400}": "must be a finite number",
    f"mass = {'7' * 5000}": "a whole number must have at most 4,300 digits",
    f"mass = 1{'_1' * 5000}": "a whole number must have at most 4,300 digits",
    f"mass = 0x1{'0' * 5000}": "[building_1] mass = a whole number of more than 308 digits",
    f"mass = {'[' * 1000}{']' * 1000}": "its lists or tables are nested too deeply",
    f"gap -> {'.'.join('a' * 20)} = 1": "the top level has an unknown key 'a'",
    f"gap -> gap.{'.'.join('a' * 19)} = 1": "gap = {a = {a = {a = ...}}} must be a finite",
    f"mass = {list(range(5000))}": "[building_1] mass = [0, 1, 2, 3, 4, 5, 6, 7, 8",
    f"period -> {'x' * 3000} = 1": f"[building_1] has an unknown key '{'x' * 75} ...;",
}
CASES = [("simulate", *fault) for fault in LONG.items()] + [
    (command, *fault) for command, lines in FAULTS.items() for fault in faults(lines)
]
DESIGN = example("design").replace('# "rod_', '"rod_')


@pytest.mark.parametrize(("command", "changes", "says"), CASES, ids=[x[1][:60] for x in CASES])
def test_a_faulty_configuration(command, changes, says, pulse, tmp_path, capsys):
    name, _, row = command.partition("_")
    path, out = tmp_path / "faulty.toml", tmp_path / "out"
    text = DESIGN if command == "design" else example(name, row or "pair")
    path.write_text(changed(text, changes))
    line = refusal(capsys, *command_for(name, path, pulse, out))
    assert line.startswith(f"jaxpound: error: {path}:")
    assert says in line
    assert line.count(path.name) == 1
    if len(changes) > 5000:
        assert len(line) < 200 + len(str(path))
