## Draws a bake to a picture and leaves: the test of lumel_lightmap.gd, and an example of its use.
##
##     godot --path PROJECT --script res://picture.gd -- res://level.glb picture.png --cam X,Y,Z,TX,TY,TZ,FOV [--exposure X]
##
## Needs a display (xvfb-run): --headless draws nothing. Import the project first: godot --headless --import --path PROJECT
extends SceneTree

const Lumel := preload("res://lumel_lightmap.gd")

## Frames until textures and shaders have reached the GPU.
const SETTLE := 4


func _initialize() -> void:
	var names: Array[String] = []
	var cam := PackedFloat64Array([0, 2, 5, 0, 0, 0, 60])
	var exposure := 0.0
	var given := OS.get_cmdline_user_args()
	var i := 0
	while i < given.size():
		match given[i]:
			"--cam":
				i += 1
				cam = given[i].split_floats(",")
			"--exposure":
				i += 1
				exposure = given[i].to_float()
			_:
				names.append(given[i])
		i += 1
	if names.size() != 2 or cam.size() != 7:
		printerr("usage: godot --path PROJECT --script res://picture.gd -- LEVEL PICTURE --cam X,Y,Z,TX,TY,TZ,FOV")
		quit(2)
		return
	_draw.call_deferred(names[0], names[1], cam, exposure)


func _draw(level_path: String, picture: String, cam: PackedFloat64Array, exposure: float) -> void:
	var scene := load(level_path) as PackedScene
	var level := scene.instantiate() as Node3D if scene else null
	if level == null:
		quit(1)
		return
	root.add_child(level)
	if Lumel.apply(level, level_path.get_basename() + ".lightmap.json", exposure) == null:
		quit(1)
		return
	var camera := Camera3D.new()
	camera.fov = cam[6]
	root.add_child(camera)
	camera.look_at_from_position(Vector3(cam[0], cam[1], cam[2]), Vector3(cam[3], cam[4], cam[5]))
	camera.make_current()
	for frame in SETTLE:
		await process_frame
	await RenderingServer.frame_post_draw
	quit(0 if root.get_texture().get_image().save_png(picture) == OK else 1)
