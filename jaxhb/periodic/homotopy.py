"""From a gentler train to the wanted one: more tooth damping, a wider transition, a stiffer gap, taken away in steps.

Where teeth hammer with little damping, time integration may wander for ever though a periodic motion exists. With four
times the damping and a soft law the motion is easily found; it is followed while the train is made what it was, with
steps that grow where Newton's method succeeds and shrink where it fails. Folds on the way end it.
"""

import dataclasses

import numpy as np

DAMPING, TRANSITION, EPSILON = 4.0, 0.4, 0.03
FIRST, SMALLEST, MOST = 0.25, 0.01, 14


def gentle(train, share):
    """``train`` for share 0, the gentlest for share 1; geometric between, so that all signs and zeros stay."""
    meshes = train.meshes
    wide = np.maximum(TRANSITION / np.asarray(meshes.transition), 1.0)
    stiff = np.maximum(EPSILON / np.maximum(np.asarray(meshes.epsilon), 1e-12), 1.0)
    changed = dataclasses.replace(
        meshes,
        damping=meshes.damping * DAMPING**share,
        transition=meshes.transition * wide**share,
        epsilon=meshes.epsilon * stiff**share,
    )
    return dataclasses.replace(train, meshes=changed)


def follow(train, solve):
    """Follow the motion of the gentlest train to that of ``train``.

    Parameters
    ----------
    train : DriveTrain
    solve : (train, start or None) -> (whether the equations are solved, deflections)

    Returns
    -------
    deflections or None, where the path was lost; number of solves
    """
    solved, motion = solve(gentle(train, 1.0), None)
    share, step, solves = 1.0, FIRST, 1
    while solved and share > 0 and step > SMALLEST and solves < MOST:
        ahead = max(share - step, 0.0)
        found, nearer = solve(gentle(train, ahead), motion)
        solves += 1
        if found:
            share, motion, step = ahead, nearer, 1.6 * step
        else:
            step /= 2.5
    return (motion if solved and share == 0 else None), solves
