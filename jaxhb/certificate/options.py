"""What steers a certificate: sizes of its equation, ends of its iterations, margins on what they leave."""

from dataclasses import dataclass

from jaxhb.results.bounds import NORM_MARGIN, ROW_SUM_MARGIN


@dataclass(frozen=True)
class CertificateOptions:
    """How a certificate is computed. Shares are of what is named, harmonics are those of the cycle.

    Parameters
    ----------
    fewest, most : harmonics in which the linearised equation is solved
    beyond_modes : times the harmonics of the tooth modes that it is solved in
    evaluated : times the harmonics it is solved in, to which it is evaluated
    receptances : harmonics to which receptances are evaluated at most: beyond twice the highest natural frequency they
        are bounded
    time_steps : of the preconditioner at most
    newton_steps : on the harmonics solved, at most
    corrected : backlashes, size of a correction that needs no other
    near_knee : backlashes, distance from the knee of a mesh below which its modes have to be resolved
    samples : time samples per harmonic at which largest values are looked for
    compared : time samples per harmonic at which the response is compared with the refined motion
    solved, krylov_steps : share of a right side that one solve may leave, and its Krylov steps at most
    unsolved : share of a right side above which the inverse shows nothing
    rounded : share of the terms of F that rounding may leave
    iterated, restarts : share of a norm at which its iteration ends, and its restarts at most
    norm_margin, row_sum_margin : factors on iterated norms and on estimated row sums
    row_sum_vectors : at a time, of the estimate of largest absolute row sums
    weight_scale : of the weights, over the limit of ``n |H(n)|``
    unsampled : share of the range of the engagement that samples may miss
    dense_disks : up to which the highest natural frequency is computed; beyond, it is bounded
    unseen : deflections per unit state, over the largest, of a motion that bends no tooth: the rotation of a train
    times, circle : times of the cycle besides those at which teeth pass knots, and points of the unit circle, at which
        multipliers are looked for
    states : of a train beyond which stability is not decided
    """

    fewest: int = 32
    most: int = 8192
    beyond_modes: int = 3
    evaluated: int = 8
    receptances: int = 2**18
    time_steps: int = 4096
    newton_steps: int = 6
    corrected: float = 1e-10
    near_knee: float = 0.02
    samples: int = 16
    compared: int = 64
    solved: float = 1e-8
    krylov_steps: int = 60
    unsolved: float = 1e-6
    rounded: float = 1e-13
    iterated: float = 1e-2
    restarts: int = 100
    norm_margin: float = NORM_MARGIN
    row_sum_vectors: int = 3
    row_sum_margin: float = ROW_SUM_MARGIN
    weight_scale: float = 3.0
    unsampled: float = 0.01
    dense_disks: int = 2000
    unseen: float = 1e-9
    times: int = 2048
    circle: int = 4096
    states: int = 200


CERTIFICATE = CertificateOptions()
