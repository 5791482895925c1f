"""The public names and where they live.

Read by type checkers, and by ``__init__.py`` when a name is first used.
"""

from ._executors import Cluster as Cluster, WorkerLost as WorkerLost, Workers as Workers
from ._program import cache_programs as cache_programs
from .balance.derivative import gradient_and_error as gradient_and_error
from .balance.harmonic_residual import (
    HarmonicResidual as HarmonicResidual,
    block_sweep as block_sweep,
    harmonic_residual as harmonic_residual,
)
from .balance.plan import Plan as Plan
from .branches.branch import (
    Branch as Branch,
    BranchOptions as BranchOptions,
    follow as follow,
)
from .branches.lift_off import LiftOff as LiftOff, lift_off as lift_off
from .branches.search import PeriodicMotion as PeriodicMotion, solve_all as solve_all
from .certificate.certificate import certify as certify
from .design import (
    identify as identify,
    tolerance as tolerance,
    tune as tune,
    tune_transient as tune_transient,
    worst_phase as worst_phase,
)
from .design.signals.orders import (
    MeasuredOrders as MeasuredOrders,
    measured_orders as measured_orders,
)
from .elements.derived import (
    shaft_stiffness as shaft_stiffness,
    viscous_damping as viscous_damping,
)
from .elements.elements import (
    Damper as Damper,
    Disk as Disk,
    Ground as Ground,
    Load as Load,
    Mesh as Mesh,
    Phase as Phase,
    Shaft as Shaft,
)
from .elements.engine import Engine as Engine
from .elements.events import (
    Clutch as Clutch,
    Event as Event,
    Ice as Ice,
    Pulse as Pulse,
)
from .elements.excitations.crank_slider import (
    Combustion as Combustion,
    Cylinder as Cylinder,
    Trace as Trace,
)
from .elements.excitations.tangential import TangentialPressure as TangentialPressure
from .elements.excitations.torque import Torque as Torque
from .elements.sentences import SceneError as SceneError
from .floquet.stability import Stability as Stability, stability as stability
from .integration.reference import (
    integrate as integrate,
    shooting_correction as shooting_correction,
)
from .linear.critical import (
    Campbell as Campbell,
    Critical as Critical,
    campbell as campbell,
    critical_speed as critical_speed,
)
from .linear.cylinders.contributions import (
    Contributions as Contributions,
    cylinder_contributions as cylinder_contributions,
)
from .linear.cylinders.tangential import (
    TangentialTable as TangentialTable,
    tangential_pressure as tangential_pressure,
)
from .linear.cylinders.vector_sums import (
    VectorSums as VectorSums,
    vector_sums as vector_sums,
)
from .linear.damped import (
    DampedModes as DampedModes,
    damped_eigenvalues as damped_eigenvalues,
    damped_modes as damped_modes,
    damping_ratios as damping_ratios,
)
from .linear.forced import (
    ForcedResponse as ForcedResponse,
    forced_response as forced_response,
    frequency_response as frequency_response,
)
from .linear.heat import heat_balance as heat_balance
from .linear.holzer import (
    HolzerTable as HolzerTable,
    holzer_residual as holzer_residual,
    holzer_table as holzer_table,
)
from .linear.modal import (
    Modes as Modes,
    all_frequencies as all_frequencies,
    natural_frequencies as natural_frequencies,
)
from .linear.polynomial import (
    characteristic as characteristic,
    characteristic_coefficients as characteristic_coefficients,
    damped_approximation as damped_approximation,
)
from .linear.sensitivity import (
    cluster_sums_hz as cluster_sums_hz,
    clusters_of as clusters_of,
    frequencies_hz as frequencies_hz,
    inertia_and_stiffness as inertia_and_stiffness,
    kinetic_energy as kinetic_energy,
    mode_shares as mode_shares,
    strain_energy as strain_energy,
)
from .linear.strength import (
    BarredRange as BarredRange,
    Strength as Strength,
    barred_ranges as barred_ranges,
    permissible_stress as permissible_stress,
    strength as strength,
    torsional_stress as torsional_stress,
)
from .linear.tangent import MeanLoad as MeanLoad, at_mean_load as at_mean_load
from .results.bounds import Certificate as Certificate, Kantorovich as Kantorovich
from .results.checkpoint import CheckpointError as CheckpointError
from .results.response import Response as Response
from .results.signal import Signal as Signal
from .results.status import (
    NotConverged as NotConverged,
    Status as Status,
    check as check,
)
from .results.steady import SteadyState as SteadyState, SteadySweep as SteadySweep
from .scene.files import load_scene as load_scene, scene_names as scene_names
from .scene.workbook.writing import scene_workbook as scene_workbook
from .scene.writer import elements_text as elements_text, scene_text as scene_text
from .solutions.misfires import (
    cut_off_each as cut_off_each,
    misfire_each as misfire_each,
)
from .solutions.solve import (
    linear_response as linear_response,
    plan as plan,
    solve as solve,
)
from .solutions.speeds import solve_speeds as solve_speeds
from .steady.closure import Cycles as Cycles
from .steady.steady_state import steady_state as steady_state
from .studies.campaign import CampaignSummary as CampaignSummary, campaign as campaign
from .studies.study import Study as Study, load_study as load_study
from .train.assembly import build as build
from .train.checks.plausible import plausibility as plausibility
from .train.drivetrain import DriveTrain as DriveTrain
from .train.kinematics import (
    Referred as Referred,
    referred as referred,
    tooth_damping_ratios as tooth_damping_ratios,
)

__version__: str
from .transients.fatigue import CountedCycles as CountedCycles, SNCurve as SNCurve
from .transients.history import (
    Envelope as Envelope,
    History as History,
    OrderMap as OrderMap,
)
from .transients.motion import ToothContact as ToothContact, Transient as Transient
from .transients.transient import transient as transient

_environment_before: dict[str, str]
