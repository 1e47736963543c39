"""Loss and gradient of the benchmark's network in PyTorch and JAX, one thread.

Reads lines "PEER POINTS WIDTH REPETITIONS", answers each with the seconds of the fastest one.
"""

import os
import sys
import time

# JAX takes as many threads as it sees cores, whatever its flags say.
os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
os.environ["OMP_NUM_THREADS"] = "1"

import jax
import jax.numpy as jnp
import numpy as np
import torch

HIDDEN_LAYERS = 5


def problem(points, width):
    """Samples and parameters of sqrhw: values in the range of real ones, since only time counts."""
    random = np.random.default_rng(1)
    shapes = [(width, 3)] + [(width, width)] * (HIDDEN_LAYERS - 1) + [(1, width)]
    weights = [
        random.normal(0, (2 / sum(shape)) ** 0.5, shape).astype(np.float32)
        for shape in shapes
    ]
    biases = [np.zeros(shape[0], np.float32) for shape in shapes]
    x = random.uniform(-1, 1, (points, 3)).astype(np.float32)
    y = random.uniform(-1, 1, (points, 1)).astype(np.float32)
    return weights, biases, x, y


def torch_evaluation(points, width):
    torch.set_num_threads(1)
    weights, biases, x, y = problem(points, width)
    weights, biases = (
        [torch.from_numpy(v).requires_grad_() for v in values]
        for values in (weights, biases)
    )
    x, y = torch.from_numpy(x), torch.from_numpy(y)

    def evaluate():
        a = x
        for h in range(HIDDEN_LAYERS):
            z = torch.nn.functional.linear(a, weights[h], biases[h])
            a = torch.tanh(z)
            if h % 2 == 0:
                a = a + z * z
        f = torch.nn.functional.linear(a, weights[-1], biases[-1])
        torch.autograd.grad(((f - y) ** 2).mean(), weights + biases)

    return evaluate


def jax_evaluation(points, width):
    weights, biases, x, y = problem(points, width)

    def loss(parameters):
        weights, biases = parameters
        a = x
        for h in range(HIDDEN_LAYERS):
            z = a @ weights[h].T + biases[h]
            t = jnp.tanh(z)
            a = t + z * z if h % 2 == 0 else t
        return jnp.mean((a @ weights[-1].T + biases[-1] - y) ** 2)

    compiled = jax.jit(jax.value_and_grad(loss))
    return lambda: jax.block_until_ready(compiled((weights, biases)))


PEERS = {"torch": torch_evaluation, "jax": jax_evaluation}


def main():
    evaluations = {}
    print(torch.__version__, jax.__version__, flush=True)
    for line in sys.stdin:
        peer, points, width, repetitions = line.split()
        key = (peer, int(points), int(width))
        if key not in evaluations:
            evaluations[key] = PEERS[peer](*key[1:])
            evaluations[key]()
        seconds = []
        for _ in range(int(repetitions)):
            start = time.perf_counter()
            evaluations[key]()
            seconds.append(time.perf_counter() - start)
        print(min(seconds), flush=True)


main()
