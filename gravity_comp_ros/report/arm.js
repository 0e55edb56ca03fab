// Draws the arm at the time of the slider, in the view of the other sliders, as a CustomJS of Bokeh.
const add = (a, b, s = 1) => a.map((x, k) => x + s * b[k])
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
const product = (a, b) => a.map(line => [0, 1, 2].map(c => dot(line, b.map(row => row[c]))))
const about_z = (q) => [[Math.cos(q), -Math.sin(q), 0], [Math.sin(q), Math.cos(q), 0], [0, 0, 1]]
const values = (name, row) => arm.numbers.map(n => samples.get_column(name + n)[row])

// Places of the base, the axes and the tool at a row of the table.
const places = (row) => {
  let frame = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], place = [0, 0, 0]
  const axes = values('q', row).map((q, i) => {
    place = add(place, frame.map(line => dot(line, arm.origins[i])))
    frame = product(product(frame, arm.rotations[i]), about_z(q))
    return place
  })
  return [[0, 0, 0], ...axes, add(place, frame.map(line => line[2]), 0.09 * arm.reach)]
}

// Parallel projection to the plot, whose ranges are -1 to 1.
const [ca, sa] = [Math.cos(azimuth.value), Math.sin(azimuth.value)]
const [ce, se] = [Math.cos(elevation.value), Math.sin(elevation.value)]
const [wide, high] = [plot.inner_width || 600, plot.inner_height || 400]
const right = [-sa, ca, 0].map(x => x * Math.min(high / wide, 1) / (0.8 * arm.reach))
const up = [-se * ca, -se * sa, ce].map(x => x * Math.min(wide / high, 1) / (0.8 * arm.reach))
const projected = (points) => {
  const seen = points.map(point => add(point, arm.middle, -1))
  return {x: seen.map(point => dot(point, right)), y: seen.map(point => dot(point, up))}
}

const t = samples.get_column('t'), chosen = samples.selected.indices
if (cb_obj === samples.selected && chosen.length) slider.value = t[chosen[0]]
let now = 0
for (let k = 0; k < t.length; k++)
  if (Math.abs(t[k] - slider.value) < Math.abs(t[now] - slider.value)) now = k
cursor.location = t[now]
cursor.visible = true

const pose = places(now), errors = values('r', now), size = arm.reach
links.data = projected(pose)
joints.data = {...projected(pose.slice(1, -1)), error: errors.map(Math.abs)}
floor.data = projected([[-size, 0, 0], [size, 0, 0], [NaN, 0, 0], [0, -size, 0], [0, size, 0]])
// Tool positions of the samples, and of the selected ones.
const tools = (rows) => projected(rows.filter(
  (row, k) => k % Math.ceil(rows.length / 300) == 0 && !isNaN(t[row])).map(row => places(row).pop()))
visited.data = tools([...t.keys()])
marked.data = tools(chosen)
const angles = values('q', now)
const joint_text = (name, i) => `${name} ${angles[i].toFixed(2)} rad, ` +
  `residual ${errors[i].toFixed(3)} N·m`
pose_text.text = `<p role="status">At ${t[now].toFixed(2)} s: ` +
  `${arm.names.map(joint_text).join('; ')}.</p>`
