"""Kit's programming guide to omni.kit.usd.layers: states and their events."""

import carb.events
import omni
import omni.kit.usd.layers as layers

context = omni.usd.get_context()
context.new_stage()
root = context.get_stage().GetRootLayer()

layers_interface = layers.get_layers(context)
layers_state = layers_interface.get_layers_state()
specs_linking = layers_interface.get_specs_linking()
specs_locking = layers_interface.get_specs_locking()

heard = []


def on_events(event: carb.events.IEvent) -> None:
    heard.append(layers.get_layer_event_payload(event).event_type)


subscription = layers_interface.get_event_stream().create_subscription_to_pop(on_events, name="example")

_, sublayer = omni.kit.commands.execute(
    "CreateSublayer", layer_identifier=root.identifier, sublayer_position=0, new_layer_path="",
    transfer_root_content=False, create_or_insert=True)
layers_state.set_layer_lock_state(sublayer, True)
print("locked:", layers_state.is_layer_locked(sublayer),
      "writable:", layers_state.is_layer_writable(sublayer))
for _ in range(3):
    omni.kit.app.get_app().update()
assert layers.LayerEventType.LOCK_STATE_CHANGED in heard, heard
print("links:", specs_linking.get_all_spec_links(), "locks:", specs_locking.get_all_locked_specs())
