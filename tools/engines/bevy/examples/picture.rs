//! Renders a bake to a picture, without a window.
//!
//!     cargo run --example picture -- out/level.glb picture.png --cam X,Y,Z,TX,TY,TZ,FOV
//!         [--exposure X] [--ktx2] [--size W,H] [--tone] [--ball X,Y,Z,R] [--mirror X,Y,Z,R]
//!
//! Exposure is a factor on everything, by default the bake's suggestion. Without `--tone`, a pixel
//! is the sRGB form of radiance × exposure, clamped. Mixed and realtime lamps light the level; the
//! file's other lamps are off. `--ball` adds a white ball without gloss, which `level.probes.ktx2`
//! lights if it is there, `--mirror` one that shows the level's reflection captures. Where the
//! device cannot show them, the exit code is 3.

use std::path::{Path, PathBuf};
use std::time::Duration;

use bevy::app::{AppExit, ScheduleRunnerPlugin};
use bevy::asset::UnapprovedPathMode;
use bevy::camera::RenderTarget;
use bevy::core_pipeline::tonemapping::Tonemapping;
use bevy::light::{EnvironmentMapLight, GlobalAmbientLight, IrradianceVolume};
use bevy::log::LogPlugin;
use bevy::pbr::Lightmap;
use bevy::prelude::*;
use bevy::render::RenderPlugin;
use bevy::render::render_resource::TextureFormat;
use bevy::render::renderer::RenderDevice;
use bevy::render::view::window::screenshot::{Screenshot, save_to_disk};
use bevy::window::ExitCondition;
use lumel_bevy::{
    LevelExposure, LevelLamp, LumelPlugin, MaskedMaterial, can_reflect, irradiance_volume,
};

/// Frames between the last file's arrival and the picture: textures reach the GPU one frame later.
const SETTLE: u32 = 4;
/// After this long, something is missing that will not arrive.
const PATIENCE: Duration = Duration::from_secs(100);

#[derive(Resource, Clone)]
struct Job {
    level: PathBuf,
    picture: PathBuf,
    from: Vec3,
    to: Vec3,
    fov: f32,
    exposure: LevelExposure,
    ktx2: bool,
    size: [u32; 2],
    tone: bool,
    ball: Option<[f32; 4]>,
    mirror: Option<[f32; 4]>,
}

fn numbers<const N: usize>(text: &str) -> Option<[f32; N]> {
    let v: Option<Vec<f32>> = text.split(',').map(|x| x.parse().ok()).collect();
    v?.try_into().ok()
}

fn arguments() -> Option<Job> {
    let mut job = Job {
        level: PathBuf::new(),
        picture: PathBuf::new(),
        from: Vec3::new(0.0, 2.0, 5.0),
        to: Vec3::ZERO,
        fov: 60.0,
        exposure: LevelExposure::Suggested,
        ktx2: false,
        size: [1280, 720],
        tone: false,
        ball: None,
        mirror: None,
    };
    let mut names = Vec::new();
    let mut given = std::env::args().skip(1);
    while let Some(word) = given.next() {
        match word.as_str() {
            "--cam" => {
                let v: [f32; 7] = numbers(&given.next()?)?;
                job.from = Vec3::from_slice(&v[0..3]);
                job.to = Vec3::from_slice(&v[3..6]);
                job.fov = v[6];
            }
            "--exposure" => job.exposure = LevelExposure::Factor(given.next()?.parse().ok()?),
            "--size" => job.size = numbers::<2>(&given.next()?)?.map(|x| x as u32),
            "--ball" => job.ball = Some(numbers(&given.next()?)?),
            "--mirror" => job.mirror = Some(numbers(&given.next()?)?),
            "--ktx2" => job.ktx2 = true,
            "--tone" => job.tone = true,
            _ => names.push(PathBuf::from(word)),
        }
    }
    let [level, picture] = names.try_into().ok()?;
    job.level = Path::new(&level).canonicalize().ok()?;
    job.picture = picture;
    Some(job)
}

fn main() -> AppExit {
    let Some(job) = arguments() else {
        eprintln!(
            "usage: picture LEVEL.glb PICTURE.png [--cam X,Y,Z,TX,TY,TZ,FOV] [--exposure X] [--ktx2] [--size W,H] [--tone] [--ball X,Y,Z,R] [--mirror X,Y,Z,R]"
        );
        return AppExit::from_code(1);
    };
    // Its appearance shows that everything is done.
    let _ = std::fs::remove_file(&job.picture);
    let folder = job.level.parent().unwrap_or(Path::new("/"));
    App::new()
        .add_plugins(
            DefaultPlugins
                .set(WindowPlugin {
                    primary_window: None,
                    exit_condition: ExitCondition::DontExit,
                    ..default()
                })
                .set(AssetPlugin {
                    file_path: folder.display().to_string(),
                    unapproved_path_mode: UnapprovedPathMode::Forbid,
                    ..default()
                })
                .set(RenderPlugin {
                    synchronous_pipeline_compilation: true,
                    ..default()
                })
                .set(LogPlugin {
                    level: bevy::log::Level::WARN,
                    ..default()
                }),
        )
        .add_plugins(ScheduleRunnerPlugin::run_loop(Duration::from_millis(5)))
        // Only the bake and its lamps light.
        .insert_resource(GlobalAmbientLight {
            brightness: 0.0,
            ..default()
        })
        .add_plugins(LumelPlugin {
            exposure: job.exposure,
            ktx2: job.ktx2,
            ..default()
        })
        .insert_resource(ClearColor(Color::srgb_u8(22, 24, 29)))
        .insert_resource(job)
        .add_systems(Startup, (setup, add_balls))
        .add_systems(Update, shoot)
        // Once the plug-in has seen the level, it has marked the lamps that stay.
        .add_systems(
            PostUpdate,
            take_out_lamps.run_if(any_with_component::<Lightmap>),
        )
        .run()
}

#[derive(Resource)]
struct Target(Handle<Image>);

fn setup(
    mut commands: Commands,
    job: Res<Job>,
    assets: Res<AssetServer>,
    mut images: ResMut<Assets<Image>>,
) {
    let name = PathBuf::from(job.level.file_name().unwrap_or_default());
    let path = bevy::asset::AssetPath::from_path_buf(name).with_label("Scene0");
    commands.spawn(WorldAssetRoot(assets.load(path)));
    let [w, h] = job.size;
    let target = images.add(Image::new_target_texture(
        w,
        h,
        TextureFormat::Rgba8UnormSrgb,
        None,
    ));
    commands.spawn((
        Camera3d::default(),
        RenderTarget::Image(target.clone().into()),
        Projection::Perspective(PerspectiveProjection {
            fov: job.fov.to_radians(),
            ..default()
        }),
        Transform::from_translation(job.from).looking_at(job.to, Vec3::Y),
        if job.tone {
            Tonemapping::ReinhardLuminance
        } else {
            Tonemapping::None
        },
        Msaa::Off,
    ));
    commands.insert_resource(Target(target));
}

type Lamp = Or<(With<PointLight>, With<SpotLight>, With<DirectionalLight>)>;

/// Also removes the specular part that the plug-in keeps of lamps that are in the lightmap.
fn take_out_lamps(mut commands: Commands, lamps: Query<Entity, (Lamp, Without<LevelLamp>)>) {
    for lamp in &lamps {
        commands
            .entity(lamp)
            .remove::<(PointLight, SpotLight, DirectionalLight)>();
    }
}

fn add_balls(
    mut commands: Commands,
    job: Res<Job>,
    assets: Res<AssetServer>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    for (ball, metallic) in [(job.ball, 0.0), (job.mirror, 1.0)] {
        let Some([x, y, z, radius]) = ball else {
            continue;
        };
        commands.spawn((
            Mesh3d(meshes.add(Sphere::new(radius).mesh().uv(128, 64))),
            MeshMaterial3d(materials.add(StandardMaterial {
                base_color: Color::WHITE,
                metallic,
                perceptual_roughness: 1.0 - metallic,
                reflectance: 0.0,
                ..default()
            })),
            Transform::from_xyz(x, y, z),
        ));
    }
    let probes = job.level.with_extension("probes.json");
    let Ok(text) = std::fs::read_to_string(&probes) else {
        return;
    };
    let name = PathBuf::from(
        job.level
            .with_extension("probes.ktx2")
            .file_name()
            .unwrap_or_default(),
    );
    let voxels = assets.load(bevy::asset::AssetPath::from_path_buf(name));
    if let Some(volume) = irradiance_volume(&text, voxels) {
        commands.spawn(volume);
    }
}

fn shoot(
    mut commands: Commands,
    job: Res<Job>,
    target: Res<Target>,
    assets: Res<AssetServer>,
    time: Res<Time<Real>>,
    device: Res<RenderDevice>,
    lit: Query<&Lightmap>,
    masked: Res<Assets<MaskedMaterial>>,
    captures: Query<&EnvironmentMapLight>,
    volumes: Query<&IrradianceVolume>,
    mut ready: Local<u32>,
    mut exit: MessageWriter<AppExit>,
) {
    if job.mirror.is_some() && !can_reflect(&device) {
        eprintln!("this Vulkan driver lacks the arrays of textures that reflection captures need");
        exit.write(AppExit::from_code(3));
        return;
    }
    let mut images = (lit.iter().map(|l| &l.image))
        .chain(masked.iter().map(|(_, m)| &m.extension.image))
        .chain(captures.iter().map(|c| &c.specular_map))
        .chain(volumes.iter().map(|v| &v.voxels));
    let loaded = !lit.is_empty() && images.all(|i| assets.is_loaded_with_dependencies(i));
    *ready = if loaded { *ready + 1 } else { 0 };
    if *ready == SETTLE {
        commands
            .spawn(Screenshot::image(target.0.clone()))
            .observe(save_to_disk(job.picture.clone()));
    }
    if *ready > SETTLE && job.picture.exists() {
        exit.write(AppExit::Success);
    }
    if time.elapsed() > PATIENCE {
        eprintln!(
            "{} lightmapped meshes, and no picture after {PATIENCE:?}",
            lit.iter().count()
        );
        exit.write(AppExit::from_code(2));
    }
}
