## Lumel's lightmaps in Godot 4.4 and later; tested with 4.6.3 (crates/lumel/tests/engines.rs).
##
##     var level := preload("res://out/level.glb").instantiate()
##     add_child(level)
##     LumelLightmap.apply(level, "res://out/level.lightmap.json")
##
## Builds a LightmapGIData from the manifest's pages and the nodes' extras, and hangs a LightmapGI with it under `root`.
## Godot shows albedo × texel, so R = E/π needs no factor; row 0 is at the top, as in the file.
class_name LumelLightmap
extends RefCounted


## Returns the LightmapGI, or null after an error that the console shows.
##
## `exposure` multiplies all that cameras without attributes of their own show; 0 takes what the bake suggests.
static func apply(root: Node3D, manifest_path: String, exposure := 0.0) -> LightmapGI:
	var text := FileAccess.get_file_as_string(manifest_path)
	var manifest: Variant = JSON.parse_string(text)
	if not manifest is Dictionary or int(manifest.get("version", 0)) != 1:
		push_error("%s: found no manifest of version 1, expected level.lightmap.json of lumel bake" % manifest_path)
		return null
	if manifest.value != "radiance":
		push_error("%s: found %s, expected radiance (lumel bake --value radiance)" % [manifest_path, manifest.value])
		return null

	# Layers of an array are of one size: smaller pages lie in the upper left corner, and their places shrink.
	var size := Vector2i.ZERO
	for page: Dictionary in manifest.pages:
		size = size.max(Vector2i(int(page.width), int(page.height)))
	var images: Array[Image] = []
	for page: Dictionary in manifest.pages:
		var image := _load_page(manifest_path.get_base_dir().path_join(page.uri))
		if image == null:
			return null
		if image.get_size() != size:
			var wide := Image.create_empty(size.x, size.y, false, image.get_format())
			wide.blit_rect(image, Rect2i(Vector2i.ZERO, image.get_size()), Vector2i.ZERO)
			image = wide
		images.append(image)
	var texture := Texture2DArray.new()
	if texture.create_from_images(images) != OK:
		push_error("%s: the pages make no Texture2DArray" % manifest_path)
		return null

	var gi := LightmapGI.new()
	gi.name = "LumelLightmap"
	root.add_child(gi)
	var data := LightmapGIData.new()
	var textures: Array[TextureLayered] = [texture]
	data.set_lightmap_textures(textures)
	data.set_uses_spherical_harmonics(false)
	# Nodes hold their places themselves, so it does not matter that Godot renames them.
	var lit := 0
	for found: MeshInstance3D in root.find_children("*", "MeshInstance3D", true, false):
		var place: Variant = found.get_meta("extras", {}).get("lightmap")
		if not place is Dictionary:
			continue
		var page: Dictionary = manifest.pages[int(place.page)]
		var share := Vector2(page.width, page.height) / Vector2(size)
		var offset := Vector2(place.offset[0], place.offset[1]) * share
		var scale := Vector2(place.scale[0], place.scale[1]) * share
		# Paths are relative to the LightmapGI; -1: the node itself, not a part of it.
		data.add_user(gi.get_path_to(found), Rect2(offset, scale), int(place.page), -1)
		found.gi_mode = GeometryInstance3D.GI_MODE_STATIC
		lit += 1
	if lit == 0:
		push_error("%s: found no node with extras.lightmap, expected the level.glb of this bake, imported by Godot 4.4 or later" % manifest_path)
		gi.queue_free()
		return null
	gi.light_data = data
	# Lamps that are baked do not light what has a lightmap.
	for light in root.find_children("*", "Light3D", true, false):
		(light as Light3D).light_bake_mode = Light3D.BAKE_STATIC
	var world := root.get_world_3d()
	if world.camera_attributes == null:
		world.camera_attributes = CameraAttributesPractical.new()
	world.camera_attributes.exposure_multiplier = exposure if exposure > 0.0 else float(manifest.get("exposure", 1.0))
	return gi


static func _load_page(path: String) -> Image:
	# Imported as a resource where the project has it; else read from the file, which needs a build with OpenEXR.
	var image: Image = null
	if ResourceLoader.exists(path):
		var resource := load(path)
		if resource is Texture2D:
			image = resource.get_image()
		elif resource is Image:
			image = resource
	if image == null:
		image = Image.load_from_file(path)
	if image == null or image.is_empty():
		push_error("%s: cannot be read as an image" % path)
		return null
	if image.is_compressed():
		image.decompress()
	image.clear_mipmaps()
	image.convert(Image.FORMAT_RGBH)
	return image
