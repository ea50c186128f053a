//! `uvms_gym.assess_scene` and `uvms_gym.recommend_integration`.

use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::{Given, dict};
use super::computation::detached;
use super::errors::OrRaise;
use super::scene::read;
use super::stability::speeds;
use uvms_gym::batch::{Trim, assess, recommend};

/// Assess a scene: trim, authority of the thrusters, and rates of the joints.
///
/// Vehicle at the origin in still water, joints at home.
///
/// Parameters
/// ----------
/// scene : str, os.PathLike or dict
///     As for `load_scene`.
///
/// Returns
/// -------
/// dict
///     trim (dict, or None for a fixed vehicle or without gravity): mass (kg), net_weight (weight less buoyancy, N), equilibrium
///     (roll and pitch, rad, at which weight and buoyancy have no moment about the vehicle's origin; None: at any attitude),
///     righting_moment (N m per rad of tilt from there), thrusts (list: the level vehicle's thrust of each thruster, N, and its
///     share of the limit), missing (wrench that the thrusters lack to hold it, N and N m), joint_torques (list: torque or
///     force of each joint, and its share of the effort). authority (list of dict, one for each axis): axis, alone (maximum
///     force or moment along the axis alone, either way, N or N m), maximum (forward and backward, whatever happens along
///     the others), acceleration (by `alone`, joints locked, m/s2 or rad/s2). joints (list of dict): name, inertia (apparent,
///     everything else free, kg m2 or kg), friction, servo, spring, detent, end_stop (rates of these causes, 1/s).
///
/// Raises
/// ------
/// SceneError
///     As `load_scene`.
#[pyfunction]
pub fn assess_scene<'py>(scene: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
    let py = scene.py();
    let scene = read(scene)?;
    let assessment = detached(py, || assess(&scene))?.or_raise()?;
    let trim = assessment.trim.map(|trim| {
        let Trim { mass, net_weight, equilibrium, righting_moment, thrusts, missing, joint_torques } = trim;
        let values = dict! { py;
            "mass": mass,
            "net_weight": net_weight,
            "equilibrium": equilibrium,
            "righting_moment": righting_moment,
            "thrusts": thrusts,
            "missing": missing,
            "joint_torques": joint_torques,
        };
        PyResult::Ok(values)
    });
    let mut authority = Vec::new();
    for entry in assessment.authority {
        authority.push(dict! { py;
            "axis": entry.axis, "alone": entry.alone, "maximum": entry.maximum, "acceleration": entry.acceleration
        });
    }
    let mut joints = Vec::new();
    for joint in assessment.joints {
        joints.push(dict! { py;
            "name": joint.name,
            "inertia": joint.inertia,
            "friction": joint.friction,
            "servo": joint.servo,
            "spring": joint.spring,
            "detent": joint.detent,
            "end_stop": joint.end_stop,
        });
    }
    let trim = trim.transpose()?;
    Ok(dict! { py; "trim": trim, "authority": authority, "joints": joints })
}

/// Recommend integrator and step for a scene's motion.
///
/// "mk4" at 0.01 s where it is stable with a margin, else a linearly implicit method, else a shorter step. Each candidate
/// simulates motions of 2 s: the vehicle at speed under full thrust along each axis, joints at speed at configurations within
/// their limits, under servos and under torques that reverse. Its error against half the step must be within 2 % of the
/// motion.
///
/// Parameters
/// ----------
/// scene : str, os.PathLike or dict
///     As for `load_scene`.
/// speed : float or array_like (6,)
///     Expected speed through the water, m/s and rad/s, along all axes or along each. By default as for `Simulator.modes`.
///
/// Returns
/// -------
/// dict
///     integrator (str) and step (float, s), as the scene's table `integration` has them; reason (str, one line); error
///     (maximum estimated error, relative to the motion); accurate (bool: False where no candidate is, and this one is
///     nearest).
///
/// Raises
/// ------
/// SceneError
///     As `load_scene`.
/// ValueError, TypeError
///     Speed that is negative, not finite or not a number.
#[pyfunction]
#[pyo3(signature = (scene, speed=None))]
pub fn recommend_integration<'py>(scene: &Bound<'py, PyAny>, speed: Given) -> PyResult<Bound<'py, PyDict>> {
    let py = scene.py();
    let (scene, speed) = (read(scene)?, speeds(speed)?);
    let found = detached(py, || recommend(&scene, speed.as_ref()))?.or_raise()?;
    Ok(dict! { py;
        "integrator": found.integration.integrator,
        "step": found.integration.step,
        "reason": found.reason,
        "error": found.error,
        "accurate": found.accurate,
    })
}
