#pragma once

// The arguments of the kernels. They are plain structs without functions: each kernel source is compiled once per
// instruction set, and the linker could keep the instructions of the wrong variant of a shared inline function.

#include <cstddef>
#include <cstdint>

namespace dfd {

/// Number of vertices in a block, which a kernel processes together, one per lane. Ranges begin at multiples of it.
constexpr std::size_t block_size = 16;

/// Number of handles in a group, whose entries are consecutive in memory. The last group is padded with zeros.
constexpr std::size_t group_size = 16;

/// The curve of a weight from 1 at the handle to 0 at its reach, for x = 1 - distance / reach; named as in Blender.
enum class Falloff : std::int32_t {
    linear,    // x, as in Eq. (5)
    smooth,    // x² (3 - 2 x)
    sharp,     // x²
    root,      // sqrt(x)
    sphere,    // sqrt(x (2 - x))
    constant,  // 1
};

/// The treatment of weights whose sum exceeds 1.
enum class Overlap : std::int32_t {
    add,        // displacements are added
    paper,      // Eq. (1) exactly: the vertex is scaled by the sum
    normalize,  // the weights are divided by their sum
};

/// The representation of transforms that is blended.
enum class Blend : std::int32_t {
    linear,           // their matrices, Eq. (1)
    dual_quaternion,  // their rigid parts as dual quaternions, and their stretches
};

/// The feature rows of the points from which distances are measured, rearranged for the kernels in G groups.
struct PackedRows {
    const float* rows = nullptr;                 // (G, D, 16): entry k of all points of a group
    const float* squares = nullptr;              // (16 G) squared length of each row
    const std::int32_t* quads = nullptr;         // (G, D / 4, 16): quads of four int8 entries of each point of a group
    const std::int32_t* pairs = nullptr;         // (G, D / 4, 2, 16): even, then odd entries of a quad, as int16
    const std::uint8_t* products_fit = nullptr;  // (16 G) whether sums of two products of neighboring bytes fit 16 bits
    const std::int32_t* quad_squares = nullptr;  // (16 G) squared length + 256 times the sum of the entries
    const float* offsets = nullptr;              // (16 G) >= 0, added to the squared distance; 0 for vertices
    std::size_t count = 0;
};

/// Largest rounding error of a geodesic distance of 1.
constexpr float geodesic_slack = 1e-5f;

/// The exponent of Eq. (7).
struct Power {
    float exponent;
    std::int32_t products;  // number of multiplications for a small integer, or -1
};

/// The reach of a handle in feature space.
struct Reach {
    float inverse;  // 1 / reach
    Falloff falloff;
};

struct BindJob {
    const void* features = nullptr;
    std::size_t vertex_count = 0;
    std::size_t dimension = 0;
    float scale = 1;                          // the feature value of 1 in an int8 entry
    PackedRows points;                        // the fixed points, then the members of each handle
    std::size_t fixed_count = 0, handle_count = 0;
    bool shaped = false;                      // whether strengths, reaches or members differ from the paper's
    const float* strengths = nullptr;         // (fixed_count) in (0, 1]
    const Reach* reaches = nullptr;           // (H)
    const std::uint32_t* members = nullptr;   // (H) number of points of each handle
    const float* geodesic = nullptr;          // (H, V) or null
    const Power* powers = nullptr;            // (H)
    float* weights = nullptr;                 // entry (i, j) at i * row_stride + j * column_stride; one stride is 1
    std::size_t row_stride = 0, column_stride = 0;
    bool stream = false;                      // whether writes bypass the caches
};

/// Bits that report invalid input in a range.
enum Fault : unsigned { no_fault = 0, features_suspect = 1, geodesic_suspect = 2 };

/// Binds the vertices [begin, end), where `begin` is a multiple of `block_size`; `scratch` is aligned to 64 bytes.
using BindRange = unsigned (*)(const BindJob& job, std::size_t begin, std::size_t end, float* scratch);

/// Number of floats of scratch memory for a range.
constexpr std::size_t bind_scratch(std::size_t dimension, std::size_t handle_count)
{
    return block_size * (dimension + 2 * handle_count + 1);
}

/// Number of blended entries of a handle. Entries are differences from those of the identity.
///
/// Linear: D_k - I as three rows (linear | translation). Dual quaternions: (w - 1, x, y, z) and the dual part. If
/// `stretched`, six entries (xx, yy, zz, yz, zx, xy) and the translation of the stretch follow.
constexpr std::size_t entries_of(Blend blend, bool stretched)
{
    return blend == Blend::linear ? 12 : stretched ? 17 : 8;
}

template <class T>
struct PoseJob {
    const T* vertices = nullptr;       // (V, 3)
    std::size_t vertex_count = 0;
    const float* weights = nullptr;    // as in BindJob
    std::size_t row_stride = 0, column_stride = 0;
    std::size_t handle_count = 0;
    Overlap overlap = Overlap::add;
    Blend blend = Blend::linear;
    bool stretched = false;            // whether dual quaternions have a stretch
    const T* positive = nullptr;       // (H, entries_of) about `center`, on the positive side of the mirror plane
    const T* negative = nullptr;       // (H, entries_of) on the negative side, or null without a mirror plane
    const T* rest = nullptr;           // (entries_of) of D_0, or null for the identity
    const T* shares = nullptr;         // (H) factors of the weights in the sum that D_0 completes to 1, or null for 1
    T center[3] = {};
    T normal[3] = {};                  // of the mirror plane
    T height = 0;                      // signed distance of `center` from the mirror plane
    T steepness = 0;                   // 1 / (2 band), or 0 without a band
    const T* base = nullptr;           // (V, 3) to which displacements are added, or null for the vertices
    const T* normals = nullptr;        // (V, 3) or null
    T* posed_normals = nullptr;
    T* posed = nullptr;                // (V, 3)
};

/// Poses the vertices [begin, end) and returns whether every result is finite.
template <class T>
using PoseRange = bool (*)(const PoseJob<T>& job, std::size_t begin, std::size_t end, float* scratch);

constexpr std::size_t pose_scratch(std::size_t handle_count) { return block_size * (handle_count + group_size); }

/// Number of points that a field evaluates together, and number of outputs in a group, whose weights are consecutive.
constexpr std::size_t field_points = 48, field_group = 8;

struct FieldLayer {
    const float* weights = nullptr;  // (groups, inputs, 8), the last group padded with zeros
    const float* bias = nullptr;     // (8 groups)
    const float* gain = nullptr;     // (8 groups) of the LayerNorm, or null for the last layer
    const float* shift = nullptr;
    std::size_t inputs = 0, outputs = 0;
};

struct FieldJob {
    const double* points = nullptr;  // (N, 3)
    double center[3] = {};
    double scale = 1;
    std::size_t octaves = 0;
    const FieldLayer* layers = nullptr;
    std::size_t layer_count = 0;
    std::size_t widest = 0;          // largest number of outputs of a layer, in whole groups
    float* features = nullptr;       // (N, D)
};

/// Evaluates a field at the points [begin, end); `scratch` is aligned to 64 bytes.
using FieldRange = void (*)(const FieldJob& job, std::size_t begin, std::size_t end, float* scratch);

constexpr std::size_t field_scratch(std::size_t widest) { return 2 * field_points * widest; }

/// The kernels of one instruction set.
struct Kernels {
    const char* name;
    BindRange bind_rows;    // features (V, D) row-major float
    BindRange bind_halves;  // features (B, D, 16) float16
    BindRange bind_bytes;   // features (B, D / 4 + 1, 16, 4): D uint8 offset by 128, then the squared length as int32
    PoseRange<float> pose_float;
    PoseRange<double> pose_double;
    FieldRange field;
};

}  // namespace dfd
