//! SIMD lanes of aarch64, where NEON is part of the base instruction set.
#![allow(unused_unsafe, reason = "so its intrinsics are safe to call")]

use std::arch::aarch64::*;
use std::ops::{Add, Div, Mul, Neg, Sub};

use super::simd::simd_lane;
use super::{Lane, assigning_ops};

simd_lane! {
    /// Two instances in double precision (NEON).
    F64x2, f64, float64x2_t, uint64x2_t, 2,
    vdupq_n_f64, vld1q_f64, vst1q_f64, vaddq_f64, vsubq_f64, vmulq_f64, vdivq_f64,
    |x, a, b| vfmaq_f64(b, x, a), vsqrtq_f64,
    |x, y| vbslq_f64(vcltq_f64(x, y), x, y), |x, y| vbslq_f64(vcltq_f64(y, x), x, y),
    vabsq_f64, vrndnq_f64, vcltq_f64, vbslq_f64,
    |mask| unsafe { vmaxvq_u32(vreinterpretq_u32_u64(mask)) } != 0
}

simd_lane! {
    /// Four instances in single precision (NEON).
    F32x4, f32, float32x4_t, uint32x4_t, 4,
    vdupq_n_f32, vld1q_f32, vst1q_f32, vaddq_f32, vsubq_f32, vmulq_f32, vdivq_f32,
    |x, a, b| vfmaq_f32(b, x, a), vsqrtq_f32,
    |x, y| vbslq_f32(vcltq_f32(x, y), x, y), |x, y| vbslq_f32(vcltq_f32(y, x), x, y),
    vabsq_f32, vrndnq_f32, vcltq_f32, vbslq_f32,
    |mask| unsafe { vmaxvq_u32(mask) } != 0
}
