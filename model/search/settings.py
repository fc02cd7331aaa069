"""Every threshold of the search and its judgement, in one place."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class SearchSettings:
    """Thresholds of full mode. Lengths are in the unit frame: shares of the bounding sphere's diameter.

    Attributes:
        refine_samples: surface samples that elements are fitted to.
        judge_samples: other samples, on which hypotheses are compared.
        many_samples: on which two hypotheses are compared that noise makes look alike.
        report_samples: samples behind the errors of the answer, drawn anew.
        file_precision: RMS deviation that rounding of coordinates and fitting leave on an exact symmetry.
        modelling_precision: RMS deviation below which two symmetries are equally good: an SDE of 1e-6, the limit of a
            clear plane.
        feature_precision: RMS deviation that a small feature without a counterpart makes, if a few samples hit it.
        growth: a group extended by a hypothesis may deviate so many times more than the group it contains.
        fit_distance: an image nearer to the surface than this fits.
        near: images nearer than this are not asked whether their counterpart is missing.
        truncation: distances count up to here while hypotheses are compared, so that a hole does not decide.
        missing_cost: what a missing share of the surface counts as RMS deviation when candidates are put in order.
        least_coverage: an element with less of the surface mapped onto surface is not believed.
        most_contradicting: nor is one with a larger share of the surface mapped to where there is none.
        least_confidence: the answer at ``auto`` is a level that is one of the intact shape with this probability.
        round_deviation: a surface is round if no point strays farther from round, as a part of the radius: between a
            regular 24-gon (0.86 %), whose order is told, and the 32 segments (0.48 %) with which most programs draw a
            cylinder.
        sphere_deviation: the same about an axis across the rings of a sphere, where two curvatures add up.
        most_unsupported: largest share of a round surface that no rotation finds a counterpart for.
        significance: one hypothesis explains the surface better than another if the mean difference of their squared
            deviations is so many standard errors from zero ...
        advantage: ... and its mean squared deviation so many times smaller.
        significance_in_noise, significance_if_likely, advantage_in_noise: the same of many samples.
        chance, chance_if_likely: what is better by fewer standard errors is not looked at on more samples.
        largest_order: of a rotation axis.
        same_angle, same_distance: two elements of one kind nearer than this are the same (radians, unit frame).
        tilt: a symmetry is compared with the same element tilted by this angle (radians) ...
        tilt_factor: ... which must be so many times worse, squared; else the shape is a lump and others would do too.
        most_planes, most_axes: local minima of the scan that are refined.
        promising_plane, promising_axis: scores of the scan, squared voxels, above which nothing is refined ...
        promising_exact: ... and above which no rotation is a symmetry if nothing is missing.
        promising_holed: the same as ``promising_plane`` where surface may be missing.
        shift: distance between parallel planes that are tried there.
    """

    refine_samples: int = 240
    judge_samples: int = 250
    many_samples: int = 2000
    report_samples: int = 1000
    file_precision: float = 2e-5
    modelling_precision: float = 1e-3
    feature_precision: float = 3e-3
    growth: float = 1.6
    fit_distance: float = 0.01
    near: float = 2e-3
    truncation: float = 0.03
    missing_cost: float = 0.01
    least_coverage: float = 0.25
    most_contradicting: float = 0.35
    least_confidence: float = 0.5
    round_deviation: float = 0.0065
    sphere_deviation: float = 0.01
    most_unsupported: float = 0.01
    significance: float = 3.5
    advantage: float = 1.12
    significance_in_noise: float = 4.5
    significance_if_likely: float = 2.5
    advantage_in_noise: float = 1.03
    chance: float = 0.5
    chance_if_likely: float = -1.0
    largest_order: int = 360
    same_angle: float = float(np.deg2rad(1.5))
    same_distance: float = 0.015
    tilt: float = float(np.deg2rad(12.0))
    tilt_factor: float = 2.0
    most_planes: int = 14
    most_axes: int = 6
    promising_plane: float = 1.5
    promising_axis: float = 1.5
    promising_exact: float = 0.7
    promising_holed: float = 3.0
    shift: float = 0.04


DEFAULT = SearchSettings()
