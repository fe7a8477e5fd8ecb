"""The network without learning, the baseline ``template``, made from the references that a model stores."""

from __future__ import annotations

from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.configfile import update
from lava_vpr.model import IntegerModel, Model, integer_model
from lava_vpr.training.loop import train
from lava_vpr.training.measuring import parts_of, references_of
from lava_vpr.training.trainers import rule_settings


def template_of(model: Model, pool: Pool = ONE_THREAD) -> IntegerModel:
    """The model of the same references and settings whose weights are the references' mean rates, one neuron a place.

    It is the one that ``train --learning template`` makes of the same stretches, bit for bit: same inputs, same
    integers, S^R measured again.

    Args:
        model: A model with an integer network, of a bundle, too.
        pool: Who measures S^R; it changes nothing.
    Raises:
        ConfigError: the model is the float conductance model, or so many neurons cost more than the limits allow.
        NetworkLimitError: the network could overflow.
    """
    config = integer_model(model, "the baseline template").config
    changes = {
        "learning": rule_settings("template", model.config),
        "network": {"neurons": 0, "neurons_per_place": 1},
    }
    settings, cut = update(config, changes), parts_of(model)
    made = train(
        references_of(model),
        settings,
        route_images=model.route_images,
        standard=model.standard,
        parts=cut,
        pool=pool,
    )
    return integer_model(made, "the baseline template")
