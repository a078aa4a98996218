#pragma once

// The arguments of the kernels. They are structs without member functions, because each kernel source is compiled once
// for each instruction set. If these variants shared an inline function, the linker would keep only one of its copies,
// perhaps with instructions that the machine does not have.

#include <cstddef>
#include <cstdint>

namespace dfd {

/// Number of vertices in a block. A kernel processes the vertices of a block together, one in each lane of its vectors.
constexpr std::size_t block_size = 16;

/// Number of points in a group, which stores entry k of all its points, then entry k + 1. Zeros fill the last group.
constexpr std::size_t group_size = 16;

/// The weight as a function of x = 1 - distance / reach: x is 1 at the handle and 0 at its reach. Names as in Blender.
enum class Falloff : std::int32_t {
    linear,    // x, as in Eq. (5)
    smooth,    // x² (3 - 2 x)
    sharp,     // x²
    root,      // sqrt(x)
    sphere,    // sqrt(x (2 - x))
    constant,  // 1 for x > 0
};

/// What happens at a vertex whose weights have a sum above 1.
enum class Overlap : std::int32_t {
    add,        // the weighted displacements are added
    paper,      // Eq. (1) exactly, which also multiplies the vertex position by the sum
    normalize,  // the weights are divided by their sum
};

/// The representation in which transforms are blended.
enum class Blend : std::int32_t {
    linear,           // matrices, Eq. (1)
    dual_quaternion,  // dual quaternions for the rigid motions, and symmetric matrices for the stretches
};

/// The feature rows of handles and fixed points, rearranged for the kernels in G groups.
struct PackedRows {
    const float* rows = nullptr;                 // (G, D, 16): entry k of all points of a group
    const float* squares = nullptr;              // (16 G) squared length of each row
    const std::int32_t* quads = nullptr;         // (G, D / 4, 16): four int8 entries (a quad) of each point of a group
    const std::int32_t* pairs = nullptr;         // (G, D / 4, 2, 16): even, then odd entries of a quad, as int16
    const std::uint8_t* products_fit = nullptr;  // (16 G) whether the sum of two neighboring byte products fits 16 bits
    const std::int32_t* quad_squares = nullptr;  // (16 G) squared length + 256 · (sum of the entries)
    const float* offsets = nullptr;              // (16 G) >= 0, added to the squared distances of each point
    std::size_t count = 0;
};

/// A geodesic distance may exceed 1 by this rounding error.
constexpr float geodesic_slack = 1e-5f;

/// The exponent of Eq. (7).
struct Power {
    float exponent;
    std::int32_t products;  // number of multiplications if `exponent` is a small integer, else -1
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
    float scale = 1;                          // an int8 entry b stands for the feature entry b * scale
    PackedRows points;                        // the fixed points, then the members of each handle
    std::size_t fixed_count = 0, handle_count = 0;
    bool general = false;                     // whether `strengths`, `reaches` or `members` differ from the paper's
    const float* strengths = nullptr;         // (fixed_count) in (0, 1]
    const Reach* reaches = nullptr;           // (H)
    const std::uint32_t* members = nullptr;   // (H) number of points of each handle
    const float* geodesic = nullptr;          // (H, V) distances along the surface, or null
    const Power* powers = nullptr;            // (H) exponents λ
    float* weights = nullptr;                 // entry (i, j) at i * row_stride + j * column_stride; one stride is 1
    std::size_t row_stride = 0, column_stride = 0;
    bool stream = false;                      // whether writes bypass the caches
};

/// Bits that report possibly invalid input in a range of vertices.
enum Fault : unsigned { no_fault = 0, features_suspect = 1, geodesic_suspect = 2 };

/// Writes the weights of the vertices [begin, end) and returns `Fault` bits. `begin` is a multiple of `block_size`, and
/// `scratch` is aligned to 64 bytes.
using BindRange = unsigned (*)(const BindJob& job, std::size_t begin, std::size_t end, float* scratch);

/// Number of floats of scratch memory for a range.
constexpr std::size_t bind_scratch(std::size_t dimension, std::size_t handle_count)
{
    return block_size * (dimension + 2 * handle_count + 1);
}

/// Returns the number of blended entries for each transform D_k. They are differences from the identity. A linear blend
/// has the matrix D_k - I (3, 4). Dual quaternions have (w - 1, x, y, z), the dual part and a translation. If `stretched`,
/// the entries (xx, yy, zz, yz, zx, xy) of the stretch minus the identity follow, and then the stretch's translation.
constexpr std::size_t entries_of(Blend blend, bool stretched)
{
    return blend == Blend::linear ? 12 : stretched ? 20 : 11;
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
    bool stretched = false;            // whether the entries of dual quaternions contain a stretch
    const T* positive = nullptr;       // (H, E) for vertices on the mirror plane's positive side; E is `entries_of`
    const T* negative = nullptr;       // (H, E) for vertices on the negative side, or null without a mirror plane
    const T* rest = nullptr;           // (E) entries of D_0, or null for the identity
    const T* shares = nullptr;         // (H) factors s in the weight max(1 - Σ s_k W_k, 0) of D_0, or null if all are 1
    T center[3] = {};                  // the point to which the coordinates of the transforms are relative
    T normal[3] = {};                  // unit normal of the mirror plane
    T height = 0;                      // signed distance of `center` from the mirror plane
    T steepness = 0;                   // 1 / (2 band) for the half width `band`, or 0 without a band
    const T* base = nullptr;           // (V, 3) positions to which displacements are added, or null for `vertices`
    const T* normals = nullptr;        // (V, 3) or null
    T* posed_normals = nullptr;
    T* posed = nullptr;                // (V, 3)
};

/// Poses the vertices [begin, end) and returns whether every result is finite.
template <class T>
using PoseRange = bool (*)(const PoseJob<T>& job, std::size_t begin, std::size_t end, float* scratch);

constexpr std::size_t pose_scratch(std::size_t handle_count) { return block_size * (handle_count + group_size); }

/// The gradients of a linear blend. A null pointer is a gradient that is not wanted.
template <class T>
struct PoseGradientJob {
    PoseJob<T> pose;              // a linear blend without `shares`, `base`, `normals` and `posed`
    const T* posed = nullptr;     // (V, 3) gradient with respect to the posed vertices
    T* vertices = nullptr;        // (V, 3) gradient with respect to the vertices
    T* weights = nullptr;         // gradient with respect to weights; entry (i, j) as in BindJob
    std::size_t row_stride = 0, column_stride = 0;
    bool transforms = false;      // whether the gradients with respect to the entries of transforms are wanted
};

/// Number of vertices whose products are summed in registers.
constexpr std::size_t gradient_tile = 128;

/// Number of entries of the table of gradients: (2, H + 1, 12) for the positive and the negative side of the mirror
/// plane. Row H is for D_0. Without a mirror plane, the second side is zero.
constexpr std::size_t gradient_entries(std::size_t handle_count) { return 2 * 12 * (handle_count + 1); }

/// Writes the gradients at the vertices [begin, end). Their sum for the entries of the transforms is written to `table`
/// (see `gradient_entries`) if it is wanted.
template <class T>
using PoseGradientRange = void (*)(const PoseGradientJob<T>& job, std::size_t begin, std::size_t end, float* scratch,
                                   double* table);

/// Number of floats of scratch memory for `PoseGradientRange`, for a type of `bytes` bytes.
constexpr std::size_t pose_gradient_scratch(std::size_t handle_count, std::size_t bytes)
{
    constexpr std::size_t line = 64;  // bytes of the widest vectors
    const std::size_t products = (2 * 12 + 1) * gradient_tile * bytes;
    const std::size_t weights = gradient_tile * handle_count * sizeof(float);
    const std::size_t weight_gradients = block_size * handle_count * bytes;
    return (products + weights + weight_gradients + gradient_entries(handle_count) * line) / sizeof(float);
}

/// A field evaluates `field_points` points together. A group of `FieldLayer` has `field_group` outputs.
constexpr std::size_t field_points = 48, field_group = 8;

struct FieldLayer {
    const float* weights = nullptr;  // (groups, inputs, 8) with 8 outputs in a group; zeros fill the last group
    const float* bias = nullptr;     // (8 groups)
    const float* gain = nullptr;     // (8 groups) gain of the LayerNorm, or null for the last layer
    const float* shift = nullptr;    // (8 groups) shift of the LayerNorm, or null for the last layer
    std::size_t inputs = 0, outputs = 0;
};

struct FieldJob {
    const double* points = nullptr;  // (N, 3)
    double center[3] = {};
    double scale = 1;
    std::size_t octaves = 0;
    const FieldLayer* layers = nullptr;
    std::size_t layer_count = 0;
    std::size_t widest = 0;          // largest number of neurons of a layer, padded to whole groups
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
    PoseGradientRange<float> pose_gradients_float;
    PoseGradientRange<double> pose_gradients_double;
    FieldRange field;
};

}  // namespace dfd
