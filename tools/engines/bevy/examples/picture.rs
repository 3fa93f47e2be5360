//! Renders a bake to a picture, without a window.
//!
//!     cargo run --example picture -- out/level.glb picture.png --cam X,Y,Z,TX,TY,TZ,FOV [--exposure X] [--ktx2] [--size W,H] [--tone]
//!
//! Exposure is a factor on everything, by default the bake's suggestion. Without `--tone`, a pixel
//! is the sRGB form of radiance × exposure, clamped. The file's lamps are off, so that only the
//! lightmap lights.

use std::path::{Path, PathBuf};
use std::time::Duration;

use bevy::app::{AppExit, ScheduleRunnerPlugin};
use bevy::asset::UnapprovedPathMode;
use bevy::camera::RenderTarget;
use bevy::core_pipeline::tonemapping::Tonemapping;
use bevy::log::LogPlugin;
use bevy::prelude::*;
use bevy::render::RenderPlugin;
use bevy::render::render_resource::TextureFormat;
use bevy::render::view::window::screenshot::{Screenshot, save_to_disk};
use bevy::window::ExitCondition;
use lumel_bevy::{LevelExposure, LumelPlugin};

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
            "usage: picture LEVEL.glb PICTURE.png [--cam X,Y,Z,TX,TY,TZ,FOV] [--exposure X] [--ktx2] [--size W,H] [--tone]"
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
        .add_plugins(LumelPlugin {
            exposure: job.exposure,
            ktx2: job.ktx2,
            ..default()
        })
        .insert_resource(ClearColor(Color::srgb_u8(22, 24, 29)))
        .insert_resource(job)
        .add_systems(Startup, setup)
        .add_systems(Update, (take_out_lamps, shoot))
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

/// Also removes the specular part that the plug-in keeps: a picture of the lightmap alone.
fn take_out_lamps(
    mut commands: Commands,
    points: Query<Entity, With<PointLight>>,
    spots: Query<Entity, With<SpotLight>>,
    suns: Query<Entity, With<DirectionalLight>>,
) {
    for e in &points {
        commands.entity(e).remove::<PointLight>();
    }
    for e in &spots {
        commands.entity(e).remove::<SpotLight>();
    }
    for e in &suns {
        commands.entity(e).remove::<DirectionalLight>();
    }
}

fn shoot(
    mut commands: Commands,
    job: Res<Job>,
    target: Res<Target>,
    assets: Res<AssetServer>,
    time: Res<Time<Real>>,
    lit: Query<&bevy::pbr::Lightmap>,
    mut ready: Local<u32>,
    mut exit: MessageWriter<AppExit>,
) {
    let loaded = !lit.is_empty()
        && lit
            .iter()
            .all(|l| assets.is_loaded_with_dependencies(&l.image));
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
