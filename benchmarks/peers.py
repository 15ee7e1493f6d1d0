"""What jaxpound is measured against, written plainly and compiled with Numba."""

import math

import numba
import numpy as np


@numba.njit
def paper_algorithm(order, tau_f, tau_x, stiffness, mass_ratio, friction, shaking, h):
    """Eqs. (10)–(12) as printed (with h^−β in the second line of eq. 10): the double loop."""
    n = shaking.size - 1
    weights = np.ones((2, n + 1))
    speed = np.empty(2)
    for i in range(2):
        speed[i] = h ** -order[i]
        for j in range(1, n + 1):
            weights[i, j] = (1 - (order[i] + 1) / j) * weights[i, j - 1]
    x, past = np.zeros((2, n + 2)), np.zeros((2, n + 1))
    f = np.zeros(2)
    phase, least = 0.0, 0.0
    for m in range(1, n + 1):
        for i in range(2):
            memory = 0.0
            for j in range(1, m + 1):
                memory += weights[i, j] * past[i, m - j]
            elastic = stiffness[i] * x[i, m] * (1 + tau_x[i] * speed[i])
            f[i] = (elastic + speed[i] * memory) / (1 + tau_f[i] * speed[i])
            past[i, m] = stiffness[i] * tau_x[i] * x[i, m] - tau_f[i] * f[i]
        hold = (-f[0] + mass_ratio * f[1]) / (1 + mass_ratio)
        slip = (x[0, m] - x[0, m - 1]) - (x[1, m] - x[1, m - 1])
        if phase == 0:
            if abs(hold) > friction:
                phase = np.sign(hold)
        elif slip * phase <= 0:
            phase = 0.0 if abs(hold) <= friction else -phase
        q = hold if phase == 0 else friction * phase
        x[0, m + 1] = 2 * x[0, m] - x[0, m - 1] + h**2 * (-f[0] - q - shaking[m])
        if phase == 0:
            x[1, m + 1] = x[0, m + 1] - (x[0, m] - x[1, m])
        else:
            push = mass_ratio * (q - f[1]) - shaking[m]
            x[1, m + 1] = 2 * x[1, m] - x[1, m - 1] + h**2 * push
        least = min(least, x[1, m] - x[0, m])
    return least


@numba.njit(parallel=True)
def paper_batch(runs, *case):
    """The paper's algorithm, one earthquake a core."""
    least = np.empty(runs)
    for i in numba.prange(runs):
        least[i] = paper_algorithm(*case)
    return least


@numba.njit(fastmath=True, error_model="numpy", parallel=True)
def modal_loop(amplitude, periods, arrivals, friction, rods, mass_ratio, h, n, tile=64):
    """Smallest x2 − x1 of a batch by jaxpound's default scheme, as one would write it by hand.

    Structure of arrays: the innermost loop runs over a tile of earthquakes, whose modes stay in the
    cache. ``periods`` and ``arrivals`` are (wavelets, runs); ``rods`` holds for each of both rods
    the coefficients of x_m, of K x_{m−1} − f_{m−1} and of S_m, K, τ_f, τ_x, ω_1 to ω_4, and then
    modal decays and weights.
    """
    runs = amplitude.size
    least = np.empty(runs)
    both = 1 + mass_ratio
    for block in numba.prange((runs + tile - 1) // tile):
        first = block * tile
        size = min(tile, runs - first)
        stiff, lag, memory = rods[:, 0], rods[:, 1], rods[:, 2]
        modulus, tau_f, tau_x, near = rods[:, 3], rods[:, 4], rods[:, 5], rods[:, 6:10]
        modes = (rods.shape[1] - 10) // 2
        decay, weight = rods[:, 10 : 10 + modes], rods[:, 10 + modes :]
        y1, y2 = np.zeros((modes, size)), np.zeros((modes, size))
        c1, c2 = np.zeros((4, size)), np.zeros((4, size))  # c_{m−j} in row (m − j) mod 4
        excess1, excess2 = np.zeros((2, size))
        sum1, sum2, shaking, minimum = np.zeros((4, size))
        x1, v1, slip, w = np.zeros((4, size))
        pull = np.zeros(size)
        for m in range(n + 1):
            shaking[:] = 0.0
            for k in range(periods.shape[0]):
                for i in range(size):
                    a = math.pi / periods[k, first + i]
                    v = (a * (m * h - arrivals[k, first + i])) ** 2
                    bend = (a * h) ** 2 / 24 * (16 * v**3 - 120 * v**2 + 180 * v - 30)
                    wavelet = 2 * a * a * (4 * v * v - 12 * v + 3 + bend) * math.exp(-v)
                    shaking[i] += amplitude[first + i] * wavelet
            if m == 0:
                v1[:] = h / 2 * shaking
            for i in range(size):
                sum1[i], sum2[i] = 0.0, 0.0
                for j in range(1, 5):
                    sum1[i] += near[0, j - 1] * c1[(m - j) % 4, i]
                    sum2[i] += near[1, j - 1] * c2[(m - j) % 4, i]
            for k in range(modes):
                weight1, weight2 = weight[0, k], weight[1, k]
                decay1, decay2 = decay[0, k], decay[1, k]
                for i in range(size):
                    sum1[i] += weight1 * y1[k, i]
                    sum2[i] += weight2 * y2[k, i]
                    y1[k, i] = decay1 * y1[k, i] + c1[m % 4, i]  # still c_{m−4}
                    y2[k, i] = decay2 * y2[k, i] + c2[m % 4, i]
            for i in range(size):
                x2 = x1[i] - slip[i]
                f1 = stiff[0] * x1[i] + lag[0] * excess1[i] + memory[0] * sum1[i]
                f2 = stiff[1] * x2 + lag[1] * excess2[i] + memory[1] * sum2[i]
                c1[m % 4, i] = modulus[0] * tau_x[0] * x1[i] - tau_f[0] * f1
                c2[m % 4, i] = modulus[1] * tau_x[1] * x2 - tau_f[1] * f2
                excess1[i], excess2[i] = modulus[0] * x1[i] - f1, modulus[1] * x2 - f2

                a = mass_ratio * f2 - f1
                d = a - pull[i]
                pull[i] = a
                hold = both * friction[first + i]
                way = 1.0 if w[i] > 0 else (-1.0 if w[i] < 0 else 0.0)
                new, jump = w[i] + h * (a - way * hold), 0.0
                half, bend, speed = way * (d / 2 - a + way * hold), way * d, abs(w[i]) / h
                dips = half > 0 and bend > half and half * half >= 2 * bend * speed
                if way * new <= 0 or dips:
                    theta = 0.0
                    if way != 0:
                        root = math.sqrt(max(half * half - 2 * bend * speed, 1e-300))
                        theta = min(2 * speed / (half + root), 1.0)
                    s = h * (theta - 0.5)
                    stop, end = a + d * (theta - 0.5), a + d / 2
                    if abs(stop) <= hold:  # sticks, and may break away
                        excess = abs(end) - hold
                        gained = math.copysign(h * excess**2 / abs(d) / 2, end)
                        slides, later = (gained if excess > 0 else 0.0), 0.0
                    else:  # turns round
                        push = h * (1 - theta) * (a + d * theta / 2)
                        slides = max(abs(push) - h * hold * (1 - theta), 0.0)
                        slides, later = (
                            math.copysign(slides, push),
                            stop - math.copysign(hold, push),
                        )
                    new = slides if hold > 0 else new
                    if way != 0:
                        jump = (later - stop + way * hold) * s * s / 2
                        turn = (a - way * hold + 2 / 3 * d * (theta - 0.5)) * s * s / 2
                        minimum[i] = min(minimum[i], turn - slip[i])
                v1[i] -= h * (f1 + (a - (new - w[i]) / h) / both + shaking[i])
                x1[i] += h * v1[i] + jump / both
                slip[i] += h * new + jump
                w[i] = new
        least[first : first + size] = minimum
    return least
