"""The method a second time, one thing at a time: what the packages compute must equal this.

`mrs bench` and the tests compare with it; it is not shipped. From the shipped packages its modules
import data types and configuration, and no function (`tests/oracle/test_imports.py` holds that). Of
the types they read attributes; what a type computes (`StereoCamera.robot_from_optical`, say) is
computed here again. Numbers that are no parameters stand in `numbers`, twice on purpose: one
that changes in the packages is noticed. What both take from elsewhere: block matching (StereoBM) is
OpenCV's, eigenvectors and inverse matrices are NumPy's, and the numbers of the fitted model are
read from its file.

In the order of the data:

    disparity, cloud      images to points
    cells                 the paper's scan: zones, noise windows, cells, tops
    search, patches, votes, evidence, bodies
                          the default scan: candidates, their patches, what these say, which are
                          bodies, their tops and their cells
    fusion, masking       the common map; robots of the team, walls and furniture on it
    clusters, splitting   the paper's people: clusters, their parts, human size
    joining               the default people: bodies of several robots as one
    people                one interval, from scans to people and their group
    tracks                one person's Kalman filter

`comparison` computes nothing of this by itself: it holds the results of the packages against it. Of
the core it runs the search and the finder of bodies, to see their steps. `scenes` makes views and
scans for the tests; it runs the core's pipeline, and no module but the tests imports it.
"""
