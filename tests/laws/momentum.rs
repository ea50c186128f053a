use nalgebra::Vector6;
use uvms_gym::batch::{Inputs};
use uvms_gym::description::Scene;
use uvms_gym::system::State;
use crate::cases::{dry, for_bodies};
use crate::random_scene::Random;
use crate::simulator;

fn scene(water: bool) -> (Scene, State) {
    let mut scene = Scene::shipped("petasus-pum").unwrap();
    scene.water.gravity.fill(0.0);
    for_bodies(&mut scene, |b| { b.damping = Default::default(); if !water { *b = dry(b); } });
    if !water { scene.water.density = 0.0; }
    for link in &mut scene.arm.as_mut().unwrap().links {
        link.joint.limits = None;
        if std::env::var("FR").is_err() { link.joint.friction = Default::default(); }
    }
    let mut state = State { rotation: Random::new(1).rotation(), q: scene.home(), position: Random::new(2).vector(1.0), ..State::default() };
    state.twist = Vector6::new(0.2, -0.1, 0.15, 0.1, -0.15, 0.2);
    state.qd[..5].copy_from_slice(&[0.5, 0.5, 0.5, 0.5, 0.5]);
    (scene, state)
}

#[test]
fn explore_momentum() {
  let free = std::env::var("FREE").is_ok();
  for water in [false, true] {
    let (scene, state) = scene(water);
    for h in [0.04, 0.02, 0.01] {
    let mut s = simulator(&scene, "mk4", h, &state);
    let books = |s: &uvms_gym::batch::Simulator| { let m = s.closed_form(0).momentum(); if water {(m.total(), m.total_scale)} else {(m.rigid, m.rigid_scale)}};
    let (m0, sc0) = books(&s);
    let mut worst = [0.0_f64; 2]; let mut rate = 0.0_f64; let mut sc=[0.0_f64;2];
    let per = (1.0 / h).round() as usize;
    for sec in 0..100 {
        // q_d = home + A sin(w t), A w = 0.5: cubic Hermite over each second
        let t = sec as f64;
        let w = 0.8; let a = 0.5/w;
        let mut target = vec![0.0; 20];
        for k in 0..5 {
            let ph = 0.7*k as f64;
            let f = |t: f64| state.q[k] + a*((w*t+ph).sin() - ph.sin());
            let g = |t: f64| a*w*(w*t+ph).cos();
            let (p0,p1,v0,v1) = (f(t),f(t+1.0),g(t),g(t+1.0));
            target[4*k..4*k+4].copy_from_slice(&[p0, v0, 3.0*(p1-p0)-2.0*v0-v1, 2.0*(p0-p1)+v0+v1]);
        }
        let inputs = Inputs { joint_target: if free {None} else {Some(&target)}, ..Inputs::default() };
        s.step(&inputs, per).unwrap();
        let st = s.state(0);
        rate = rate.max(st.qd.iter().fold(0.0, |m: f64, x| m.max(x.abs())));
        let (m, c) = books(&s);
        for p in 0..2 { worst[p] = worst[p].max((m-m0).fixed_rows::<3>(3*p).norm() / sc0[p]); sc[p] = c[p]; }
    }
    println!("water {water} h {h} drift {worst:?} rate {rate} |m| {:?} scale {sc0:?} {sc:?}", (m0.fixed_rows::<3>(0).norm(), m0.fixed_rows::<3>(3).norm()));
    }
  }
}
