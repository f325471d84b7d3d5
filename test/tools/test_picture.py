from dragon_ros.tools.picture import contact_picture
from dragon_ros.wire.figures import save
from dragon_ros.wire.scenes import load_scene


def test_the_contact_is_drawn_as_png_and_svg(tmp_path):
    scene = load_scene('first_contact', ['dragon.benches=30'])
    png, svg = save(contact_picture(scene, 412.473838, (0, 8), (1.4744, 2.1107)), tmp_path / 'contact')
    assert png.read_bytes().startswith(b'\x89PNG')
    text = svg.read_text()
    assert '</svg>' in text
    assert len(text) > 20_000
