// Draws the arm as capsules, in the view set by the sliders; runs in a CustomJS of Bokeh.
const value = (name, row) => samples.get_column(name + row.n)[row.k]
const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]]
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
const times = (m, v) => m.map(line => dot(line, v))
const product = (a, b) => a.map(line => [0, 1, 2].map(c => line[0] * b[0][c] + line[1] * b[1][c]
  + line[2] * b[2][c]))
const about_z = (q) => [[Math.cos(q), -Math.sin(q), 0], [Math.sin(q), Math.cos(q), 0], [0, 0, 1]]

// Position and frame of each axis; the last point is the tool.
const posed = (angles) => {
  let frame = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], place = [0, 0, 0]
  const joints = angles.map((q, i) => {
    place = add(place, times(frame, arm.origins[i]))
    frame = product(product(frame, arm.rotations[i]), about_z(q))
    return {place, axis: frame.map(line => line[2])}
  })
  return {joints, tool: add(place, joints[joints.length - 1].axis, 0.09 * arm.reach)}
}

const t = samples.get_column('t'), chosen = samples.selected.indices
if (cb_obj === samples.selected && chosen.length) {
  // Show the selected sample with the largest residual relative to the RMSE of its joint.
  let largest = -1
  for (const k of chosen) {
    const size = Math.max(...arm.numbers.map((n, i) =>
      Math.abs(value('r', {n, k})) / arm.rmse[i]))
    if (size > largest) { largest = size; slider.value = t[k] }
  }
}
let now = 0
for (let k = 0; k < t.length; k++)
  if (Math.abs(t[k] - slider.value) < Math.abs(t[now] - slider.value)) now = k
cursor.location = t[now]
cursor.visible = true

// Perspective projection to the plot, whose ranges are -1 to 1.
const [ca, sa] = [Math.cos(azimuth.value), Math.sin(azimuth.value)]
const [ce, se] = [Math.cos(elevation.value), Math.sin(elevation.value)]
const right = [-sa, ca, 0], up = [-se * ca, -se * sa, ce], towards = [ce * ca, ce * sa, se]
const [wide, high] = [plot.inner_width || 600, plot.inner_height || 400]
const projected = (point) => {
  const p = add(point, arm.middle, -1), near = 1 / (1 - dot(p, towards) / (5 * arm.reach))
  const size = near / (0.8 * arm.reach)
  return {x: dot(p, right) * size * Math.min(high / wide, 1),
          y: dot(p, up) * size * Math.min(wide / high, 1),
          depth: dot(p, towards), pixels: 0.5 * Math.min(wide, high) * size}
}
const items = []
const rod = (from, to, radius, colour, alpha = 1, nearer = 0) => {
  const a = projected(from), b = projected(to)
  items.push({a, b, colour, alpha, width: Math.max(radius * (a.pixels + b.pixels), 0.8),
              depth: 0.5 * (a.depth + b.depth) + nearer})
}
const [faint, outline, visited, marked] = palette
const capsule = (from, to, radius, colour) => {
  rod(from, to, radius + 0.004 * arm.reach, outline)
  rod(from, to, radius, colour, 1, 1e-6)
}
for (let k = -4; k <= 4; k++) {
  const s = k * arm.reach / 4
  rod([s, -arm.reach, 0], [s, arm.reach, 0], 0, faint, 0.35, -9)
  rod([-arm.reach, s, 0], [arm.reach, s, 0], 0, faint, 0.35, -9)
}
const angles = arm.numbers.map(n => value('q', {n, k: now}))
const pose = posed(angles), radius = 0.035 * arm.reach
const errors = arm.numbers.map(n => value('r', {n, k: now}))
const shade = (error) => {
  const share = Math.min(Math.abs(error) / colours.high, 1)
  return colours.palette[Math.round(share * (colours.palette.length - 1))]
}
const colours_of = [faint, ...errors.map(shade)]
const places = [[0, 0, 0], ...pose.joints.map(joint => joint.place), pose.tool]
for (let i = 0; i + 1 < places.length; i++)
  capsule(places[i], places[i + 1], radius, colours_of[i])
pose.joints.forEach(({place, axis}, i) => {
  const half = (s) => add(place, axis, s * 1.5 * radius)
  capsule(half(-1), half(1), 1.3 * radius, colours_of[i + 1])
})
// Tool positions of all samples, and of the selected samples in the colour of selections.
const dots = (rows, colour, alpha) => {
  const step = Math.max(1, Math.floor(rows.length / 300))
  for (let j = 0; j < rows.length; j += step) {
    const q = arm.numbers.map(n => value('q', {n, k: rows[j]}))
    if (q.some(isNaN)) continue
    const {tool} = posed(q)
    rod(tool, tool, 0.006 * arm.reach, colour, alpha)
  }
}
dots([...t.keys()], visited, 0.5)
dots(chosen, marked, 1)

items.sort((a, b) => a.depth - b.depth)
drawn.data = {
  x0: items.map(one => one.a.x), y0: items.map(one => one.a.y),
  // A rod of length 0 is a dot, which requires a small length to be drawn.
  x1: items.map(one => one.b.x + 1e-4), y1: items.map(one => one.b.y),
  colour: items.map(one => one.colour), alpha: items.map(one => one.alpha),
  width: items.map(one => one.width)}
const joint_text = (name, i) => `${name} ${angles[i].toFixed(2)} rad, ` +
  `residual ${errors[i].toFixed(3)} N·m`
pose_text.text = `<p role="status">At ${t[now].toFixed(2)} s: ` +
  `${arm.names.map(joint_text).join('; ')}.</p>`
