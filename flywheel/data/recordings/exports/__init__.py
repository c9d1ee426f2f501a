"""Episodes in formats that viewers and trainers of others read."""

from flywheel.data.recordings.exports.lerobot import write_lerobot
from flywheel.data.recordings.exports.mcap_files import write_mcap

__all__ = ["write_lerobot", "write_mcap"]
