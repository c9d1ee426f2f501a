"""Settings of the network, one field per component so that each can be ablated."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import SerializerFunctionWrapHandler, model_serializer, model_validator

from flywheel.quantities import Bounds, ControlStep, PositiveRobotLengths
from flywheel.validation import Frozen


class NetworkConfig(Frozen):
    """Shape and inputs of a `ChunkNetwork`. The defaults are the `lean` network.

    Attributes:
      decomposition: body nodes stand at the tracked points ("caps"), or at every geometric piece of
        a body and at the tracked points without one ("primitives").
      width: of all latent vectors.
      rounds: L, of message passing.
      chunk: n, the control steps predicted by one call.
      dt: control step [s].
      control_history: h, past controls in a cable's features.
      warmup_chunks: measured past prediction chunks that the LSTM runs through before it predicts.
      velocity_window: steps of the measured past in the fit of node velocities; 1 is the backward
        difference, more is for noisy points.
      smooth_present: also take the present positions from that fit instead of the measurement.
      config_features: give nodes their position relative to a designated node and to their body's
        centre of mass, and the body's axis.
      load_features: give nodes the acceleration that cables and gravity alone would cause by the robot's
        numbers (0 in the measured past), and the logarithm of their distance to the ground. Needs
        cable_ends "attachments".
      cable_ends: ends of a cable in its features: the points of attachment on the bodies, with a
        rod's invisible roll computed from the cables ("attachments"), or the nodes that represent
        them ("nodes").
      recurrent: an LSTM on the body nodes.
      winch: the rest-length changes are the cable decoder's ("learned"), the decoder's on top of
        the nominal winch's ("residual"), or the nominal winch's alone ("analytic").
      edge_updates: edges carry latent vectors that every round updates (an interaction network).
        Else edge encodings stay constant, and the message of a round is a single layer of them and
        of the nodes.
      mlp_layers: linear layers of the encoders, of the decoders and, with edge_updates, of the
        messages and updates.
      layer_norm: normalise the encoded latents, and the nodes' after each round.
      contact_edges: connect nodes near the ground with it; else only their distance is an input.
      surfaces: to which each node has contact edges: 1 is the ground below alone, more are the nearest boxes,
        too.
      contact_threshold: distance below which there is a contact edge, as a fraction of the robot's
        length.
      ground_clamp: largest ground distance in a node's features, likewise.
      yaw_frame: express all inputs and outputs in a frame that turns with the robot about the
        vertical, so that predictions turn with it exactly. Else in world axes, where this must be
        learned from rotated training data. A robot with cables to the world is always seen in world axes.
      datasets: size of the data sets' one-hot.
      mechanics: all changes of velocities are the network's ("learned"), or it adds to those by cables
        and gravity from the robot's numbers, with the attachments of the MJCF ("mjcf"), on the circles of
        the end caps ("heuristic"), or at the tracked points ("uninformed"). The latter three need a
        chunk of 1 and cable_ends "attachments".
    """

    decomposition: Literal["caps", "primitives"] = "caps"
    width: Annotated[int, Bounds(4, 4096)] = 64
    rounds: Annotated[int, Bounds(1, 64)] = 3
    chunk: Annotated[int, Bounds(1, 16)] = 6
    dt: ControlStep = 0.01
    control_history: Annotated[int, Bounds(0, 1000, "steps")] = 20
    warmup_chunks: Annotated[int, Bounds(0, 1000)] = 3
    velocity_window: Annotated[int, Bounds(1, 1000, "steps")] = 1
    smooth_present: bool = False
    config_features: bool = True
    load_features: bool = True
    cable_ends: Literal["attachments", "nodes"] = "attachments"
    recurrent: bool = True
    winch: Literal["learned", "residual", "analytic"] = "residual"
    edge_updates: bool = False
    mlp_layers: Annotated[int, Bounds(2, 32)] = 2
    layer_norm: bool = False
    contact_edges: bool = True
    surfaces: Annotated[int, Bounds(1, 8)] = 1
    contact_threshold: PositiveRobotLengths = 0.1
    ground_clamp: PositiveRobotLengths = 0.2
    yaw_frame: bool = True
    datasets: Annotated[int, Bounds(1, 1000)] = 10
    mechanics: Literal["learned", "mjcf", "heuristic", "uninformed"] = "learned"

    @model_validator(mode="after")
    def _loads_at_attachments(self) -> Self:
        if self.load_features and self.cable_ends != "attachments":
            raise ValueError("load_features need cable_ends attachments; got nodes")
        return self

    @model_validator(mode="after")
    def _analytic_mechanics_step_by_step(self) -> Self:
        if self.mechanics != "learned" and (self.chunk, self.cable_ends) != (1, "attachments"):
            raise ValueError(
                f"mechanics {self.mechanics} needs a chunk of 1 and cable_ends attachments; got "
                f"{self.chunk} and {self.cable_ends}"
            )
        return self

    @model_validator(mode="after")
    def _edges_to_surfaces(self) -> Self:
        if self.surfaces > 1 and not self.contact_edges:
            raise ValueError(f"surfaces {self.surfaces} need contact_edges true; got false")
        return self

    @model_serializer(mode="wrap")
    def _as_before_boxes(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Without `surfaces` if it is 1: networks that see no boxes keep their digests."""
        values: dict[str, Any] = handler(self)
        return values if self.surfaces > 1 else {k: v for k, v in values.items() if k != "surfaces"}

    @classmethod
    def lean(cls, **changes: Any) -> NetworkConfig:
        """Nodes at the end caps, static edge encodings, small widths: the default."""
        return cls(**changes)

    @classmethod
    def paper(cls, width: int = 512, **changes: Any) -> NetworkConfig:
        """The paper's network; at its own width of 512 it is hundreds of times slower than `lean`."""
        settings: dict[str, Any] = {
            "decomposition": "primitives",
            "load_features": False,
            "cable_ends": "nodes",
            "rounds": 4,
            "winch": "learned",
            "edge_updates": True,
            "mlp_layers": 3,
            "layer_norm": True,
            "yaw_frame": False,
        }
        return cls(width=width, **(settings | changes))

    @classmethod
    def hybrid(cls, **changes: Any) -> NetworkConfig:
        """A network that adds contacts to analytic cables and gravity, a control step at a time."""
        settings: dict[str, Any] = {
            "mechanics": "mjcf",
            "load_features": False,
            "chunk": 1,
            "control_history": 0,
            "recurrent": False,
            "winch": "analytic",
        }
        return cls(**(settings | changes))

    @property
    def history(self) -> int:
        """Past steps that a prediction needs, for the controls, the velocities and the LSTM."""
        warmup = self.warmup_chunks * self.chunk if self.recurrent else 0
        return max(self.control_history, warmup + self.velocity_window)
