"""The messages that introduce a run in a bag, as ``sim`` publishes them and a recorder stores them."""
from dragon_ros.messages.cdr import string_message
from dragon_ros.messages.channels import channels
from dragon_ros.messages.latched import latched_messages
from dragon_ros.scenes.provenance import RECORD, run_metadata, scene_file


def introduce(bag, scene, about=None, metadata=None, latched=None):
    """Write the metadata record and the latched messages.

    ``about`` is added to this section of the scene file, ``metadata`` to the record; ``latched`` replaces messages.
    """
    text = scene_file(scene, about)
    bag.describe(RECORD, run_metadata(text, scene, {}) | (metadata or {}))
    for name, data in {'scene': string_message(text), **latched_messages(scene, 'dragon'), **(latched or {})}.items():
        bag.add_channel(f'/dragon/{name}', channels()[name])
        bag.write(f'/dragon/{name}', data, scene.run.start_ns, 1)
