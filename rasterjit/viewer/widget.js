// Around the front end of rendercanvas, whose text stands in BASE: the picture that is saved in the
// notebook is hidden while the view is there, a kernel that does not answer is spoken of, and a
// picture of another size than the view is asked for again.

const ANSWER = 1500 // a kernel that is not busy answers sooner, milliseconds
const AGAIN = 400 // after this long a picture has the size of its view, milliseconds
const MAX_TRIES = 20
const WAITED_FOR = ['pointer_down', 'pointer_up', 'wheel', 'key_down', 'resize']
const PNG = 'data:image/png;base64,'
const HEAD = 400 // characters of a PNG file that hold its first texts

const BUSY = 'The kernel is busy; the view follows when it is done.'
const LOST = 'No connection to the kernel; the view follows when it is back.'
const GONE = 'The kernel of this view is gone; run its cell again.'

// The first texts of a picture that stands in the page; somebody else's may be no file.
function headOf (image) {
  try {
    return atob(image.src.slice(PNG.length, PNG.length + HEAD))
  } catch {
    return ''
  }
}

// The model of one widget, between rendercanvas and the kernel.
class Link {
  constructor (model) {
    this.model = model
    this.views = new Set()
    this.waits = false
    this.asked = 0
    this.isGone = false
    this.timer = 0
    this.kernel = null
    this.onStatus = () => this.look()
    // What rendercanvas takes for the model.
    this.between = {
      get: (name) => model.get(name),
      set: (name, value) => model.set(name, value),
      save_changes: () => model.save_changes(),
      on: (name, callback) => model.on(name, callback),
      off: (name, callback) => model.off(name, callback),
      send: (message, ...rest) => this.send(message, ...rest),
      widget_manager: model.widget_manager
    }
    model.on('msg:custom', (message) => this.hear(message))
    this.look()
  }

  // The kernel of a manager that tells.
  found () {
    try {
      return this.model.widget_manager.kernel ?? null
    } catch {
      return null
    }
  }

  // Take notice of what the kernel does.
  look () {
    const kernel = this.found()
    if (kernel !== null && kernel !== this.kernel) {
      if (this.kernel !== null) { this.isGone = true }
      this.kernel = kernel
      kernel.statusChanged?.connect(this.onStatus)
      kernel.connectionStatusChanged?.connect(this.onStatus)
      kernel.disposed?.connect(this.onStatus)
    }
    const known = this.kernel
    if (known !== null) {
      const ends = ['restarting', 'autorestarting', 'terminating', 'dead']
      if (known.isDisposed || ends.includes(known.status)) { this.isGone = true }
      const isLost = ['connecting', 'disconnected'].includes(known.connectionStatus)
      if (isLost && !this.isGone) { this.say(LOST) } else if (!this.waits) { this.say('') }
    }
    if (this.isGone) { this.say(GONE) }
  }

  send (message, ...rest) {
    this.model.send(message, ...rest)
    if (!this.waits && WAITED_FOR.includes(message.type)) {
      this.waits = true
      // What asks for no picture is answered too.
      this.model.send({ type: 'rasterjit-ask', number: ++this.asked })
      this.timer = setTimeout(() => this.late(), ANSWER)
    }
  }

  // Nothing came for long.
  late () {
    this.look()
    if (!this.waits || this.isGone) { return }
    const isLost = ['connecting', 'disconnected'].includes(this.kernel?.connectionStatus)
    this.say(isLost ? LOST : BUSY)
    this.timer = setTimeout(() => this.late(), ANSWER)
  }

  // An answer came; a picture may have been on its way before the question.
  hear (message) {
    if (message.type !== 'rasterjit-answer' || message.number !== this.asked) { return }
    this.waits = false
    clearTimeout(this.timer)
    if (!this.isGone) { this.say('') }
  }

  say (text) {
    for (const view of this.views) { view.say(text) }
  }

  close () {
    clearTimeout(this.timer)
    this.kernel?.statusChanged?.disconnect(this.onStatus)
    this.kernel?.connectionStatusChanged?.disconnect(this.onStatus)
    this.kernel?.disposed?.disconnect(this.onStatus)
  }
}

// One place where the widget stands.
class View {
  constructor (link, element) {
    this.link = link
    this.hidden = new Set()
    this.status = document.createElement('div')
    this.status.className = 'rasterjit-status'
    this.status.setAttribute('role', 'status')
    this.status.hidden = true
    element.classList.add('rasterjit-view')
    element.appendChild(this.status)
    this.picture = element.querySelector('img')
    this.picture.alt = link.model.get('_alt')
    this.describes = () => { this.picture.alt = link.model.get('_alt') }
    link.model.on('change:_alt', this.describes)
    this.wanted = null
    this.tries = 0
    this.timer = 0
    this.sizes = new ResizeObserver((entries) => this.resized(entries[entries.length - 1]))
    this.sizes.observe(this.picture)
    this.finds = setInterval(() => this.replace(), 500)
    this.replace()
    link.views.add(this)
  }

  // Hide the saved picture of this widget; until the kernel sends another, show it here.
  replace () {
    const name = this.link.model.get('_name')
    if (!name) { return }
    for (const image of document.querySelectorAll(`img[src^="${PNG}"]`)) {
      if (image === this.picture || !headOf(image).includes(name)) { continue }
      if (this.picture.naturalWidth <= 1) { this.picture.src = image.src }
      const output = image.closest('.jp-OutputArea-child, .output_area') ?? image
      output.style.display = 'none'
      this.hidden.add(output)
    }
  }

  say (text) {
    if (this.status.textContent !== text) { this.status.textContent = text }
    this.status.hidden = text === ''
  }

  // See later whether the picture has the size that the view has from now on.
  resized (entry) {
    const box = entry.devicePixelContentBoxSize?.[0]
    const ratio = window.devicePixelRatio
    this.wanted = box
      ? [box.inlineSize, box.blockSize]
      : [Math.floor(entry.contentRect.width * ratio), Math.floor(entry.contentRect.height * ratio)]
    this.tries = 0
    clearTimeout(this.timer)
    this.timer = setTimeout(() => this.compare(), AGAIN)
  }

  compare () {
    const [width, height] = this.wanted
    const { naturalWidth, naturalHeight } = this.picture
    const fits = width === naturalWidth && height === naturalHeight
    if (fits || width * height === 0 || this.link.isGone || ++this.tries > MAX_TRIES) { return }
    const ratio = window.devicePixelRatio
    this.link.model.send({
      type: 'resize',
      width: width / ratio,
      height: height / ratio,
      pwidth: width,
      pheight: height,
      ratio,
      timestamp: performance.now() / 1000
    })
    this.link.model.send({ type: 'rasterjit-again' })
    this.timer = setTimeout(() => this.compare(), AGAIN)
  }

  close () {
    clearTimeout(this.timer)
    clearInterval(this.finds)
    this.sizes.disconnect()
    this.link.model.off('change:_alt', this.describes)
    this.link.views.delete(this)
    for (const output of this.hidden) { output.style.display = '' }
  }
}

async function baseModule () {
  const address = URL.createObjectURL(new Blob([BASE], { type: 'text/javascript' }))
  try {
    const found = (await import(/* webpackIgnore: true */ address)).default
    return typeof found === 'function' ? await found() : found
  } finally {
    URL.revokeObjectURL(address)
  }
}

export default async () => {
  const base = await baseModule()
  let link
  return {
    async initialize (context) {
      link = new Link(context.model)
      const end = await base.initialize({ ...context, model: link.between })
      return async () => {
        link.close()
        await end?.()
      }
    },
    async render (context) {
      const end = await base.render({ ...context, model: link.between })
      const view = new View(link, context.el)
      link.look()
      return async () => {
        view.close()
        await end?.()
      }
    }
  }
}
