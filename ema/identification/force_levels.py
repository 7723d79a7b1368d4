"""The force levels of a configuration identified, each by itself."""

from __future__ import annotations

from ema.campaign.campaign import Campaign
from ema.campaign.measurement import Measurement, read_force_levels
from ema.identification.amplitude import Level
from ema.identification.identify import identify_frf
from ema.quality.channels import check, usable
from ema.types.errors import EmaError


def identify_force_levels(campaign: Campaign, name: str) -> tuple[tuple[Level, ...], tuple[str, ...]]:
    """Identify a configuration at its other force levels.

    Parameters
    ----------
    campaign : Campaign
    name : str
        The configuration.

    Returns
    -------
    levels : tuple of Level
        Those that can be identified.
    lost : tuple of str
        What is wrong with the others; they do not end these.

    Raises
    ------
    CampaignError, MeasurementError
        The files of a level cannot be read.
    """
    levels, lost = [], []
    for measurement in read_force_levels(campaign, name):
        try:
            levels.append(_level(campaign, measurement))
        except EmaError as error:
            lost.append(f"{measurement.name} is left out of the modes over amplitude: {error}")
    return tuple(levels), tuple(lost)


def _level(campaign: Campaign, measurement: Measurement) -> Level:
    options, force = campaign.identification, measurement.configuration.force
    kept = usable(measurement, check(measurement, options.band))
    modes = identify_frf(
        kept.frf,
        kept.geometry,
        name=measurement.name,
        band=options.band,
        order=options.order,
        sensor_mass=campaign.sensor_mass,
    )
    return Level(force=float(force or 0.0), frf=kept.frf, modal_model=modes)
